"""Control: discrete blocks, the state machine of a move, the estimator in open loop, tuning by model."""

from .blocks import LowPass as LowPass
from .blocks import Notch as Notch
from .blocks import Pid as Pid
from .blocks import Regulator as Regulator
from .estimator import Estimator as Estimator
from .estimator import StepModel as StepModel
from .inverse import PiezoInverse as PiezoInverse
from .moving import MoveError as MoveError
from .moving import Mover as Mover
from .moving import Walk as Walk
from .quantised import NoiseShaped as NoiseShaped
from .settling import WINDOWS as WINDOWS
from .settling import Settling as Settling
from .settling import settling as settling
from .shaping import Shaper as Shaper
from .shaping import Shaping as Shaping
from .simulated import simulate_control as simulate_control
from .steps import Steps as Steps
from .steps import StepTable as StepTable
from .tuning import MarginError as MarginError
from .tuning import Margins as Margins
from .tuning import Requirement as Requirement
from .tuning import Tuning as Tuning
from .tuning import check_margins as check_margins
from .tuning import tune as tune
