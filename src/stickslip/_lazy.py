"""Names that are imported when they are first used, from the stub beside an ``__init__.py``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any
from warnings import warn

import lazy_loader


def attach(
    package: str, file: str, former: Mapping[str, str] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package; what an extra lacks is named with its extra.
    `former` names are as of `renamed`."""
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

    return renamed(package, former or {}, found), names, listed


def renamed(
    package: str, former: Mapping[str, str], imported: Callable[[str], Any] | None = None
) -> Callable[[str], Any]:
    """`__getattr__` of a package for names that it had before, until 0.2; others are `imported`."""

    def found(name: str) -> Any:
        if name in former:
            warn(f"{package}.{name} is {package}.{former[name]}", DeprecationWarning, stacklevel=2)
            return getattr(sys.modules[package], former[name])
        if imported is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return imported(name)

    return found
