"""Names that are imported when they are first used, from the stub beside an ``__init__.py``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import lazy_loader


def attach(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package; a missing extra is named."""
    imported, names, listed = lazy_loader.attach_stub(package, file)

    def found(name: str) -> Any:
        try:
            return imported(name)
        except ModuleNotFoundError as missing:
            lacking = str(missing.name).partition(".")[0]
            if lacking == "stickslip":
                raise
            needs = f"{package}.{name} needs {lacking}, which is not installed"
            raise ModuleNotFoundError(f'{needs}: pip install "stickslip[all]"', name=lacking) from None

    return found, names, listed
