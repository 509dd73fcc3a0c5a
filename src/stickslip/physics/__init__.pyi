from . import contact as contact
from . import electronics as electronics
from . import piezo as piezo
from .actuator import Actuator as Actuator
from .actuator import PulledSlider as PulledSlider
from .actuator import load_actuator as load_actuator
from .actuator import load_pulled_slider as load_pulled_slider
from .stage_modes import StageModes as StageModes
