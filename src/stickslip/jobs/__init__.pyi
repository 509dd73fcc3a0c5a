from . import campaign as campaign
from .campaign import run_campaign as run_campaign
from .known import catalogue as catalogue
from .running import run_job as run_job
