"""Twins of controllers: simulated devices that answer in a maker's protocol and move simulated stages.

Unmodified drivers of the controllers move the stages (`tests/twins`). The module docstring of each twin, in
`rig/devices`, lists its assumptions beyond the behaviour that these drivers show.
"""

from .axis import Clock as Clock
from .axis import WallClock as WallClock
from .making import make_twin as make_twin
from .server import HangUp as HangUp
from .server import TwinServer as TwinServer
from .server import TwinTerminal as TwinTerminal
from .stage import Stage as Stage
