"""Controllers of Physik Instrumente (PI)."""

from .e871 import E871Client as E871Client
from .piezo_controller import PiRig as PiRig
