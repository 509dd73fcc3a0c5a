"""Identification: a fit from recordings of steps, walks, loops, frequency responses and events."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
