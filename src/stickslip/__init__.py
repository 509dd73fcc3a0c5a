"""stickslip: identify, verify, simulate and design piezoelectric stick-slip actuators.

What daily work needs is here, everything else in sub-packages: ``ss.simulate``, ``ss.rig.VirtualRig``. Public
names are listed, with their types, in ``__init__.pyi``; each is imported when it is first used, so that
``import stickslip`` costs next to nothing.
"""

from ._lazy import attach as _attach

__getattr__, __dir__, __all__ = _attach(__name__, __file__)
