"""The ``struct law`` of a user's law, before it has functions."""

from __future__ import annotations

from typing import Any

from ._abi import ffi
from .laws import functions, numbers, place_of_period, smooth
from .translator import Record


def begun(law_type: type, kind: Record) -> tuple[Any, Any]:
    """Return a ``struct law`` without functions, and its name, which must live as long as it does."""
    made: Any = ffi.new("struct law *")
    name = ffi.new("char[]", law_type.__name__.encode("ascii", "replace"))
    made.name, made.parameters, made.smooth = name, numbers(kind), smooth(law_type)
    made.period = place_of_period(kind) if "tick" in functions(law_type) else -1
    return made, name
