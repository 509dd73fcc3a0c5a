"""Positioners: controllers that generate the steps and scans of stick-slip stages themselves.

A rig puts out a drive and records; a positioner receives a number of steps. Each file registers a client by
name in `registry.positioners`. The client's `about` says what it was tested on.
"""

from .anc300 import Anc300Client as Anc300Client
from .kim101 import Kim101Client as Kim101Client
from .mcs2 import Mcs2Client as Mcs2Client
from .protocols import Positioner as Positioner
from .protocols import Ranges as Ranges
from .protocols import wait as wait
