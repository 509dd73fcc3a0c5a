"""Simulation: from a model and a drive signal to a labelled trajectory, to steady steps, to many members at
once, and to derivatives by parameters; the public calls over `engine`."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
