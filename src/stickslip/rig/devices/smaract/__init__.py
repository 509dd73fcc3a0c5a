"""SmarAct's controllers."""

from .mcs2 import Mcs2Client as Mcs2Client
