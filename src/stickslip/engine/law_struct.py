"""The struct of a user's law, before it has functions."""

from __future__ import annotations

from typing import Any

from ._abi import ffi
from .interface import Interface, numbers
from .translator import Record


def begun(interface: Interface, kind: Record) -> tuple[Any, Any]:
    """Return an empty C struct for a law of this record type, and the C string of its name, which must be
    kept as long."""
    made: Any = ffi.new(f"struct {interface.name} *")
    name = ffi.new("char[]", kind.record_class.__name__.encode("ascii", "replace"))
    made.name, made.parameters = name, numbers(kind)
    for member, value in interface.numbers(kind).items():
        setattr(made, member, value)
    return made, name
