"""Signal chain between a computer and an actuator: converters, amplifier, piezo stack, sensors, filters.

Each part is a record of datasheet numbers with a function or method on arrays, usable alone; `stickslip.rig`
combines them. `load_part` and similar functions load parts by name, `driven` and `driven_period` return the
voltage of a waveform at the piezo, and `electrical` the current, losses and temperature of a stack. Noise
comes from the given ``numpy.random.Generator``: the same seed gives the same noise.
"""

from .account import electrical as electrical
from .amplifier import Amplifier as Amplifier
from .amplifier import amplifier_output as amplifier_output
from .amplifier import small_signal_bandwidth as small_signal_bandwidth
from .converter import Adc as Adc
from .converter import Dac as Dac
from .converter import adc_output as adc_output
from .converter import dac_output as dac_output
from .driven import driven as driven
from .driven import driven_period as driven_period
from .filters import Filter as Filter
from .filters import filtered as filtered
from .inductive import InductiveSensor as InductiveSensor
from .interferometer import Encoder as Encoder
from .interferometer import Interferometer as Interferometer
from .interferometer import PositionSensor as PositionSensor
from .output import OutputStage as OutputStage
from .parts import Part as Part
from .parts import available_parts as available_parts
from .parts import load_amplifier as load_amplifier
from .parts import load_part as load_part
from .parts import load_stack as load_stack
from .stack import Stack as Stack
from .stack import TemperatureDependence as TemperatureDependence
from .strain_gauge import StrainGauge as StrainGauge
