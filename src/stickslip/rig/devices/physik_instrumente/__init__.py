"""Controllers of Physik Instrumente (PI): a client for stick-slip stages, and a rig for piezo actuators."""

from .e871 import E871Client as E871Client
from .piezo_controller import PiRig as PiRig
