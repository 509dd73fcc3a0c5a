"""Views of results: what a report, a notebook and a terminal show of each type of result."""

from . import comparison as comparison
from . import conditions as conditions
from . import control as control
from . import data_sheet as data_sheet
from . import datasets as datasets
from . import drives as drives
from . import fits as fits
from . import plan as plan
from . import posterior as posterior
from . import step_law as step_law
from . import verification as verification
