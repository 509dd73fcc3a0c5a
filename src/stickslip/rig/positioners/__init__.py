"""Positioners: controllers that step and scan stick-slip stages themselves, each by its own protocol.

A rig puts out a drive and records; a positioner is told how many steps. Each file adds one by name, to
`registry.positioners`; what a client was tried on stands in its `about`.
"""

from .anc300 import Anc300Client as Anc300Client
from .kim101 import Kim101Client as Kim101Client
from .mcs2 import Mcs2Client as Mcs2Client
from .protocols import Positioner as Positioner
from .protocols import Ranges as Ranges
from .protocols import wait as wait
