"""Modes and outputs in identification files, with their checks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator
from pydantic_core import PydanticCustomError

from ...identify.frequency.modal import ModalModel, identify_frequency
from ...quantities.units import to_si

if TYPE_CHECKING:
    import xarray as xr

Starts = list[tuple[float, float]]

MOST_MODES = 60


def refused(why: str) -> PydanticCustomError:
    """Return the error of a file whose parts contradict each other."""
    return PydanticCustomError("analysis", "{why}", {"why": why})


def _whole(value: Any, most: float) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _modes(value: Any) -> int | Starts:
    """Check a number of modes, or the initial values of each."""
    if _whole(value, MOST_MODES):
        return value
    pairs = value if isinstance(value, list | tuple) else []
    if (
        not pairs
        or len(pairs) > MOST_MODES
        or not all(isinstance(p, list | tuple) and len(p) == 2 for p in pairs)
    ):
        raise refused(
            f"{value!r} is neither a number of modes, 1 to {MOST_MODES}, nor a list of starts "
            "[frequency in Hz, damping ratio]"
        )
    found = [(to_si(f, "Hz", "frequency"), to_si(z, "", "damping ratio")) for f, z in pairs]
    for pair in found:
        if not all(np.isfinite(pair)) or min(pair) <= 0.0:
            raise refused(f"the start {list(pair)} needs a frequency and a damping ratio above 0")
    return found


def _outputs(value: Any) -> tuple[int, ...]:
    """Check one output or several."""
    given = value if isinstance(value, list | tuple) else [value]
    if not given or not all(_whole(o, np.inf) for o in given) or len(set(given)) < len(given):
        raise refused(f"{value!r} is no output, counted from 1, and no list of different ones")
    return tuple(given)


Modes = Annotated[
    int | Starts, BeforeValidator(_modes, json_schema_input_type=int | list[tuple[float | str, float]])
]
Outputs = Annotated[tuple[int, ...], BeforeValidator(_outputs, json_schema_input_type=int | list[int])]


def count(modes: int | Starts) -> int:
    """Return the number of modes."""
    return modes if isinstance(modes, int) else len(modes)


def started(response: xr.Dataset, modes: int | Starts) -> Starts | ModalModel:
    """Return initial values: the given ones, or the modes and delay identified from a response."""
    return identify_frequency(response, modes).model if isinstance(modes, int) else modes
