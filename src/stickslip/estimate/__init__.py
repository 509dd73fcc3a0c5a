"""Estimation: from residuals to a fit with its noise, uncertainty and identifiability. These modules contain
no physics."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
