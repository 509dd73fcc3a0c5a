"""stickslip: identify, verify, simulate and design piezoelectric stick-slip actuators.

Names for daily work are in this package (``ss.simulate``), all others in sub-packages
(``ss.rig.VirtualRig``). Public names are listed, with their types, in ``__init__.pyi``; each is imported when
it is first used, so that ``import stickslip`` takes little time.
"""

from ._lazy import attach as _attach

__getattr__, __dir__, __all__ = _attach(__name__, __file__)
