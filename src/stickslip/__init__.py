"""stickslip: identify, verify, simulate and design piezoelectric stick-slip actuators.

Public names are listed, with their types, in ``__init__.pyi``; each is imported when it is first used, so
that ``import stickslip`` costs next to nothing.
"""

import lazy_loader as _lazy

_imported, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    try:
        return _imported(name)
    except ModuleNotFoundError as missing:
        if str(missing.name).startswith("stickslip"):
            raise
        needs = f"stickslip.{name} needs {missing.name}, which is not installed"
        raise ModuleNotFoundError(f'{needs}: pip install "stickslip[all]"', name=missing.name) from None
