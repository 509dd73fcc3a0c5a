"""Control: discrete blocks, the state machine of a move, the estimator in open loop, tuning by model."""

from .._lazy import renamed as _renamed
from .blocks import ControlWarning as ControlWarning
from .blocks import LowPass as LowPass
from .blocks import Notch as Notch
from .blocks import Pid as Pid
from .blocks import Regulator as Regulator
from .commanded import Commanded as Commanded
from .commanded import commanded as commanded
from .estimator import Estimator as Estimator
from .estimator import StepModel as StepModel
from .inverse import PiezoInverse as PiezoInverse
from .learned import Learnt as Learnt
from .moving import MoveError as MoveError
from .moving import Mover as Mover
from .moving import Stepping as Stepping
from .portable import export_mover as export_mover
from .portable import export_regulator as export_regulator
from .portable import mover_source as mover_source
from .portable import regulator_source as regulator_source
from .quantised import NoiseShaped as NoiseShaped
from .relay import Oscillation as Oscillation
from .relay import Relay as Relay
from .settling import WINDOWS as WINDOWS
from .settling import Settling as Settling
from .settling import settling as settling
from .shaping import Shaper as Shaper
from .shaping import Shaping as Shaping
from .shaping import Slip as Slip
from .simulated import simulate_control as simulate_control
from .steps import Steps as Steps
from .steps import StepSizes as StepSizes
from .tuning import MarginError as MarginError
from .tuning import Margins as Margins
from .tuning import Requirement as Requirement
from .tuning import Tuning as Tuning
from .tuning import check_margins as check_margins
from .tuning import tune as tune

__getattr__ = _renamed(__name__, {"Walk": "Stepping", "StepTable": "StepSizes"})
