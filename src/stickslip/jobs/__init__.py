"""Files that describe recording, identification, verification, comparison, design and export; their
runners.
"""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
