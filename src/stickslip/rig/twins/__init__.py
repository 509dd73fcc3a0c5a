"""Twins of controllers: servers that use a maker's protocol, with our simulated stage behind them.

Unmodified drivers of the controllers move the stages (`tests/twins`). The top of each twin's file, in
`rig/devices`, lists what it assumes beyond what these drivers show.
"""

from .axis import Clock as Clock
from .axis import WallClock as WallClock
from .making import make_twin as make_twin
from .server import HangUp as HangUp
from .server import TwinServer as TwinServer
from .server import TwinTerminal as TwinTerminal
from .stage import Stage as Stage
