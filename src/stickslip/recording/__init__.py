"""Recordings: one schema for measured and simulated data, in memory and on disk; calibration; readers of
other files, and export to other formats."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
