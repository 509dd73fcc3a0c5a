"""Drive signals: waveforms for users (such as `Sawtooth`) and the segment table for the engine (`Drive`).

A waveform is an object that fulfils the protocol `signal.Waveform`; a simulation gets the signal from its
method ``drive(duration)``, and steady stepping needs its `period` [s]. A user's own waveform is a class in
the user's file that builds its table with `pieces.assemble` or `pieces.repeat`, as `shapes` and `periodic`
do; `signal.signal_record` registers it.

Values are in volts, or in metres with ``unit="m"`` (radians: ``"rad"``): the same shapes drive a piezo and
the base of a spring-pulled slider.
"""

# Lists of waveforms have the order of these imports, then the waveforms of a user's files.
# isort: off
from . import periodic as periodic
from . import shapes as shapes
from . import knots as knots
from . import multisine as multisine
from . import sampled as sampled
from . import sequence as sequence

# isort: on
from .drive import Drive as Drive
from .knots import PeriodicKnots as PeriodicKnots
from .multisine import Multisine as Multisine
from .periodic import Cycloid as Cycloid
from .periodic import ReverseSawtooth as ReverseSawtooth
from .periodic import Sawtooth as Sawtooth
from .periodic import Sine as Sine
from .periodic import Triangle as Triangle
from .sampled import Sampled as Sampled
from .sequence import Sequence as Sequence
from .shapes import Chirp as Chirp
from .shapes import Constant as Constant
from .shapes import Ramp as Ramp
from .shapes import Rest as Rest
from .shapes import Step as Step
from .signal import Waveform as Waveform
from .signal import check_range as check_range
