"""Equations of an actuator: piezo, stage, contact, electronics; each with units, assumptions and source."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
