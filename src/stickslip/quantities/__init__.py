"""Units, records of checked quantities, the registry of laws and devices, progress, and input files."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
