"""The public names of the package: those of the top level, and those of its sub-packages."""

from __future__ import annotations

import inspect
from types import ModuleType
from typing import Any

import stickslip as ss


def _rooms(module: ModuleType, above: str = "") -> dict[str, ModuleType]:
    """The sub-packages that a package lists, and theirs, by dotted name."""
    found: dict[str, ModuleType] = {}
    for name in getattr(module, "__all__", ()):
        if isinstance(room := getattr(module, name), ModuleType):
            found |= {above + name: room} | _rooms(room, f"{above}{name}.")
    return found


ROOMS = _rooms(ss)
TOP = {name: getattr(ss, name) for name in ss.__all__ if name not in ROOMS and not name.startswith("_")}


def names_of(room: ModuleType) -> dict[str, Any]:
    """Return the objects that a sub-package defines, or exports in its `__init__`, by name."""
    listed = getattr(room, "__all__", None) or vars(room)
    found = {name: getattr(room, name) for name in listed if not name.startswith("_")}
    return {name: one for name, one in found.items() if _own(one, room)}


def _own(one: Any, room: ModuleType) -> bool:
    if isinstance(one, ModuleType) or not (inspect.isclass(one) or inspect.isfunction(one)):
        return False
    package = hasattr(room, "__path__")  # whose `__init__` says what is public
    return one.__module__.startswith("stickslip.") and (package or one.__module__ == room.__name__)


def everything() -> dict[str, Any]:
    """All public calls and types, as one writes them behind ``ss.``."""
    return TOP | {
        f"{room}.{name}": one
        for room, module in ROOMS.items()
        for name, one in names_of(module).items()
        if TOP.get(name) is not one
    }
