"""Files that say what to record, identify, verify, compare, design and export, and what runs them."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
