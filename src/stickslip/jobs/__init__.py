"""Input files that describe recording, identification, verification, comparison, design, moves, calibration
of steps and export; their runners.

A job is a sequence of such steps.
"""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
