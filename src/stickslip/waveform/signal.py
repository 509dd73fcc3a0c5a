"""Interface of waveforms: the protocol, the shared methods, their units, the range check."""

from __future__ import annotations

import functools
import math
import os
from typing import Any, Literal, Protocol, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities import registry
from ..quantities.records import DURATION, quantities, record
from ..quantities.units import QuantityError, array_si, to_si, with_prefix
from .drive import Drive, evaluate

T = TypeVar("T")
Unit = Literal["V", "m", "rad"]


class Waveform(Protocol):
    """A drive signal u(t): `unit` is "V", "m" or "rad"; after `duration` [s] it rests (infinite: never)."""

    @property
    def unit(self) -> str: ...

    @property
    def duration(self) -> float: ...

    def drive(self, duration: float) -> Drive:
        """Return the segment table of the drive for 0 <= t < duration [s]; a jump at the very end is left
        out."""
        ...

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value over all time, limits of jumps included."""
        ...


# The shared methods are functions that each class takes into its body by name: a NamedTuple cannot have a
# second base class, and a decorator that adds methods would hide them from editors and type checkers.


def value_at(waveform: Waveform, t: ArrayLike) -> NDArray[np.float64]:
    """Return the value u at times t [s] (finite), in an array of their shape; at a jump, the value after it.
    Raises QuantityError for other times."""
    return _evaluated(waveform, t, 0)


def slope_at(waveform: Waveform, t: ArrayLike) -> NDArray[np.float64]:
    """Return the slope du/dt at times t [s] (finite), in an array of their shape; at a kink, the slope after
    it; jumps are left out. Raises QuantityError for other times."""
    return _evaluated(waveform, t, 1)


def breaks_within(waveform: Waveform, duration: float | str) -> NDArray[np.float64]:
    """Return the times [s] in [0, duration), 0 first, at which a new formula starts, such as jumps and
    kinks."""
    return waveform.drive(DURATION.check(duration, "duration")).start.copy()


def _evaluated(waveform: Waveform, t: ArrayLike, which: int) -> NDArray[np.float64]:
    times = array_si(t, "s", "t")
    if not np.all(np.isfinite(times)):
        raise QuantityError("t [s] must be finite times")
    last = max(float(times.max(initial=0.0)), 0.0)
    table = waveform.drive(last * (1 + 1e-9))  # a little further, for a jump at the last time is wanted too
    return evaluate(table, times)[which].reshape(times.shape)[()]


def check_unit(unit: Any, owner: str) -> None:
    """Raise QuantityError unless the unit is "V", "m" or "rad"."""
    if unit not in get_args(Unit):
        raise QuantityError(f"{owner}.unit = {unit!r}: a waveform is in 'V', in 'm' or in 'rad'")


def signal_record(named_tuple: type[T]) -> type[T]:
    """Make a ``NamedTuple`` a waveform that checks its fields, as `records.record` does; fields declared in V
    (or V/s) are read in the record's `unit`.

    The waveform is registered by its name.
    """
    checked = record(named_tuple)
    checked_new = checked.__new__
    following = {name: q for name, q in quantities(named_tuple).items() if q.unit.startswith("V")}

    @functools.wraps(named_tuple.__new__)
    def __new__(cls: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            given: dict[str, Any] = named_tuple(*args, **kwargs)._asdict()  # type: ignore[attr-defined]
        except TypeError:
            return checked_new(cls, *args, **kwargs)  # which says what field is missing or unknown
        check_unit(given["unit"], cls.__name__)
        for name, quantity in following.items():
            quantity = quantity._replace(unit=quantity.unit.replace("V", given["unit"]))
            label, value = f"{cls.__name__}.{name}", given[name]
            if isinstance(value, tuple | list | np.ndarray):
                given[name] = tuple(quantity.check(v, f"{label}[{i}]") for i, v in enumerate(value))
            else:
                given[name] = quantity.check(value, label)
        return checked_new(cls, **given)

    checked.__new__ = staticmethod(__new__)  # type: ignore[method-assign]
    registry.waveforms.add(checked)
    return checked


def shape(text: str, folder: str | os.PathLike[str] | None = None) -> Any:
    """Return the type of a waveform that is made from fields.

    Args:
        text: name, or ``path.py:Name``, whose file is executed.
        folder: folder of the file that contains the name; None if the user gives the name.

    Raises:
        RegistryError: the name is unknown, or the waveform is not made from fields.
    """
    found = registry.waveforms.find(text, folder)
    if not hasattr(found, "_fields"):
        raise registry.RegistryError(
            f"{text} is not made from fields: in an input file, parts are listed one after the other, and "
            "samples are a file"
        )
    return found


def check_range(waveform: Waveform, minimum: float | str, maximum: float | str) -> None:
    """Check that a waveform stays within limits.

    Args:
        waveform: the drive signal.
        minimum, maximum: limits in its own unit, or strings with units.

    Raises:
        QuantityError: it exceeds a limit; the message names the value reached, the limit and the unit.
    """
    unit = waveform.unit
    least, most = to_si(minimum, unit, "minimum"), to_si(maximum, unit, "maximum")
    low, high = waveform.range()
    for value, limit, sign, words in (
        (low, least, -1, "below the minimum"),
        (high, most, 1, "above the maximum"),
    ):
        if math.isnan(limit):
            raise QuantityError(f"the limit of the drive is no number (expected {unit})")
        if sign * (value - limit) > 1e-12 * abs(limit):  # 0.1 V + 0.2 V may reach 0.3 V
            shown, name = with_prefix(value, unit, 6), type(waveform).__name__
            raise QuantityError(f"{name} reaches {shown}, {words} of {with_prefix(limit, unit, 6)}")
