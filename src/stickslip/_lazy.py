"""Import names when they are first used, as listed in the stub beside an ``__init__.py``."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from typing import Any

import lazy_loader


def attach(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package whose names are imported when they are first
    used.

    Args:
        package: name of the package (``__name__``).
        file: path of its ``__init__.py``, beside the stub ``__init__.pyi`` that lists the names.

    The returned `__getattr__` raises AttributeError for an unknown name, with a similar name if there is one,
    and ModuleNotFoundError with the command to install a missing package.
    """
    imported, names, listed = lazy_loader.attach_stub(package, file)

    def found(name: str) -> Any:
        try:
            return imported(name)
        except AttributeError as error:
            if name in listed:
                raise
            close = get_close_matches(name, listed, n=1)
            hint = f": did you mean {close[0]!r}?" if close else f"; dir({package}) lists the names"
            raise AttributeError(f"{package} has no {name!r}{hint}", name=name) from error
        except ModuleNotFoundError as missing:
            lacking = str(missing.name).partition(".")[0]
            if lacking == "stickslip" or "pip install" in str(missing):
                raise
            needs = f"{package}.{name} needs {lacking}, which is not installed"
            raise ModuleNotFoundError(f'{needs}: pip install "stickslip[all]"', name=lacking) from None

    return found, names, listed
