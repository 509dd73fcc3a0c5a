"""Calibration of sensors: polynomials fitted to tables, with their uncertainty, saved as files and applied by
name."""

from ..._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
