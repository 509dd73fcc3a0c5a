"""Fits of models to recordings: steps, walks, friction loops, frequency responses and stick-slip events."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
