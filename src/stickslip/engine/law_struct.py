"""Make the C struct of a user's law, still without functions."""

from __future__ import annotations

from typing import Any

from ._abi import ffi
from .interface import Interface, numbers
from .translator import Record


def begun(interface: Interface, kind: Record) -> tuple[Any, Any]:
    """Return a C struct for a law of a record type, with its name and integer members, but without functions.
    Also return the C string of the name, which must exist as long as the struct.

    Args:
        interface: declaration of the struct.
        kind: the translator's type of the record.
    """
    made: Any = ffi.new(f"struct {interface.name} *")
    name = ffi.new("char[]", kind.record_class.__name__.encode("ascii", "replace"))
    made.name, made.parameters = name, numbers(kind)
    for member, value in interface.numbers(kind).items():
        setattr(made, member, value)
    return made, name
