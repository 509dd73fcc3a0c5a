"""Fields of a frequency-response file for vibration modes and outputs, with their checks."""

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
    """Return the pydantic error for a wrong value, or contradicting values, in a file; the caller raises it.

    `why` is its message.
    """
    return PydanticCustomError("analysis", "{why}", {"why": why})


def _whole(value: Any, most: float) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _modes(value: Any) -> int | Starts:
    """Check the field `modes`: return a number of modes, or initial values of the modes in SI.

    Initial values are pairs of natural frequency [Hz] and damping ratio. Raises the error of `refused` for
    anything else, such as a number above `MOST_MODES`, and QuantityError for a wrong unit.
    """
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
    """Check the field `output`: return the numbers of the outputs, counted from 1, as a tuple.

    Raises the error of `refused` for anything else.
    """
    given = value if isinstance(value, list | tuple) else [value]
    if not given or not all(_whole(o, np.inf) for o in given) or len(set(given)) < len(given):
        raise refused(f"{value!r} is no output, counted from 1, and no list of different ones")
    return tuple(given)


Modes = Annotated[
    int | Starts, BeforeValidator(_modes, json_schema_input_type=int | list[tuple[float | str, float]])
]
Outputs = Annotated[tuple[int, ...], BeforeValidator(_outputs, json_schema_input_type=int | list[int])]


def count(modes: int | Starts) -> int:
    """Return the number of modes, also if initial values are given."""
    return modes if isinstance(modes, int) else len(modes)


def started(response: xr.Dataset, modes: int | Starts) -> Starts | ModalModel:
    """Return initial values of a modal fit: the given pairs or, for a number of modes, a fitted model.

    The model has modes and delay; it is fitted to `response`, a frequency response.
    """
    return identify_frequency(response, modes).model if isinstance(modes, int) else modes
