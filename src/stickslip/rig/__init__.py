"""Rigs: a drive output and a recorder, virtual or real, and recordings from them."""

from .bench import Bench as Bench
from .bench import available_benches as available_benches
from .bench import load_bench as load_bench
from .capture import Capture as Capture
from .capture import CaptureError as CaptureError
from .capture import Trigger as Trigger
from .closed_loop import regulate as regulate
from .gate import Gate as Gate
from .home import Home as Home
from .hosted import HostedRig as HostedRig
from .hosted import Link as Link
from .hosted import folder_of as folder_of
from .limits import LimitError as LimitError
from .limits import Limits as Limits
from .measurement import measure as measure
from .protocols import Capabilities as Capabilities
from .protocols import Controller as Controller
from .protocols import Rig as Rig
from .protocols import RigError as RigError
from .protocols import StreamingRig as StreamingRig
from .recorded import Channel as Channel
from .scpi import ScpiRig as ScpiRig
from .variation import Repeats as Repeats
from .variation import Variation as Variation
from .virtual import VirtualRig as VirtualRig
from .watching import WatchedRig as WatchedRig
