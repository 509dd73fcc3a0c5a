"""Controllers of SmarAct: a client of the MCS2; `twin` simulates the device."""

from .mcs2 import Mcs2Client as Mcs2Client
