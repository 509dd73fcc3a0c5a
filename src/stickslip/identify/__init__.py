"""Fits of models to recordings: steps, walks, friction loops, steady friction, piezo, frequency responses and
stick-slip events; comparison of models, verification, and storage of fits."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
