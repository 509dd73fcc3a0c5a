"""Piezo models: what lies between the voltage and the free stroke of an actuator."""

from .creep import Creep as Creep
from .model import Piezo as Piezo
from .prandtl_ishlinskii import PrandtlIshlinskii as PrandtlIshlinskii
