"""Identification files: YAML files that describe what to read, fit and verify, and their reports."""

from ..._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
