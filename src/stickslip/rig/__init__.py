"""Rigs: a drive output and a recorder, virtual or real; recordings and closed loops with them; limits,
interlock and home; positioners."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
