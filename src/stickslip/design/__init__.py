"""Design with an identified model: maps and tables of the step, limits of stepping, optimised drive signals
and actuators, fronts of two goals, planned experiments, and models from data sheets."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
