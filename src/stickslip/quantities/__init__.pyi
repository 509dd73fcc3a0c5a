from . import units as units
from .units import QuantityError as QuantityError
