"""Design with an identified model: maps of the step, optimised drive signals, planned experiments."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
