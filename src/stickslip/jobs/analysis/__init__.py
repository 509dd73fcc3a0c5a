"""Identification files: a YAML file says what to read, fit and verify; running it gives a report's
document."""

from ..._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
