"""stickslip: identify, verify, simulate and design piezoelectric stick-slip actuators.

Public names are listed, with their types, in ``__init__.pyi``; each is imported when it is first used, so
that ``import stickslip`` costs next to nothing.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
