"""Piezo models: hysteresis and creep between the voltage and the free stroke of an actuator."""

from .bouc_wen import BoucWen as BoucWen
from .creep import Creep as Creep
from .duhem import output as duhem_output  # noqa: F401  (its public name)
from .duhem import register as register_piezo  # noqa: F401  (its public name)
from .maxwell_capacitor import MaxwellCapacitor as MaxwellCapacitor
from .model import Piezo as Piezo
from .prandtl_ishlinskii import PrandtlIshlinskii as PrandtlIshlinskii
