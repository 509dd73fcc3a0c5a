"""Twins of controllers: servers that use a maker's protocol, with our simulated stage behind them.

Unmodified drivers of the controllers move the stages (`tests/twins`). The top of each twin's file lists what
it assumes beyond what these drivers show.
"""

from .anc300 import Anc300 as Anc300
from .axis import Clock as Clock
from .axis import WallClock as WallClock
from .kim101 import Kim101 as Kim101
from .making import TWINS as TWINS
from .making import make_twin as make_twin
from .mcs2 import Mcs2 as Mcs2
from .nv200 import Nv200 as Nv200
from .server import HangUp as HangUp
from .server import TwinServer as TwinServer
from .server import TwinTerminal as TwinTerminal
from .stage import Stage as Stage
