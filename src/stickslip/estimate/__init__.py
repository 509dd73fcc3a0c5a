"""From residuals to a fit: least squares, noise, uncertainty, what the data do not determine. No physics."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
