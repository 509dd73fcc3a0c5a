"""Identification files (YAML), which describe what to read, fit and verify; their runners and reports."""

from ..._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
