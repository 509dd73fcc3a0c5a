"""Rigs: a drive output and a recorder, virtual or real, and recordings from them."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
