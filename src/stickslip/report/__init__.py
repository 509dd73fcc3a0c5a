"""Reports: a document as plain data, written as one HTML file (on request also PDF), one JSON file and the
figures."""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
