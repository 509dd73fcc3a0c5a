"""Interface of waveforms: the protocol, the methods that all waveforms share, units, and the range check."""

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
    """Drive signal u(t) in `unit` ("V", "m" or "rad"), which is constant after `duration` [s].

    An infinite duration means that the signal does not end.
    """

    @property
    def unit(self) -> str: ...

    @property
    def duration(self) -> float: ...

    def drive(self, duration: float) -> Drive:
        """Return the drive for 0 <= t < duration [s] as a table of segments, each with its formula (`Drive`).

        A jump at t = duration is left out.
        """
        ...

    def range(self) -> tuple[float, float]:
        """Return the least and greatest value over all time, including both values at a jump."""
        ...


# The methods that waveforms share are functions, which each class names in its body: a NamedTuple cannot have
# a second base class, and a decorator that adds methods would hide them from editors and type checkers.


def value_at(waveform: Waveform, t: ArrayLike) -> NDArray[np.float64]:
    """Return the value u at times t [s], in an array of the same shape; at a jump, the value after the jump.

    Raises QuantityError for times that are not finite.
    """
    return _evaluated(waveform, t, 0)


def slope_at(waveform: Waveform, t: ArrayLike) -> NDArray[np.float64]:
    """Return the slope du/dt at times t [s], in an array of the same shape.

    At a kink or a jump it is the slope after it, so a jump adds nothing. Raises QuantityError for times that
    are not finite.
    """
    return _evaluated(waveform, t, 1)


def breaks_within(waveform: Waveform, duration: float | str) -> NDArray[np.float64]:
    """Return the break points of a waveform: the times [s] in [0, duration) at which a segment starts.

    At these times the signal may have a jump or a kink. The first break point is 0. Raises QuantityError
    unless the duration is above 0 and finite.
    """
    return waveform.drive(DURATION.check(duration, "duration")).start.copy()


def _evaluated(waveform: Waveform, t: ArrayLike, which: int) -> NDArray[np.float64]:
    times = array_si(t, "s", "t")
    if not np.all(np.isfinite(times)):
        raise QuantityError("t [s] must be finite times")
    last = max(float(times.max(initial=0.0)), 0.0)
    # A table to the last time would leave out a jump at this time, so take a slightly longer one.
    table = waveform.drive(last * (1 + 1e-9))
    return evaluate(table, times)[which].reshape(times.shape)[()]


def check_unit(unit: Any, owner: str) -> None:
    """Raise QuantityError, which names the waveform `owner`, unless the unit is "V", "m" or "rad"."""
    if unit not in get_args(Unit):
        raise QuantityError(f"{owner}.unit = {unit!r}: a waveform is in 'V', in 'm' or in 'rad'")


def signal_record(named_tuple: type[T]) -> type[T]:
    """Class decorator: make a ``NamedTuple``, one of whose fields is `unit`, a waveform with checked fields,
    and register it by its name.

    The fields are checked as by `records.record`. Fields that are declared in V (or V/s) are read in the
    waveform's own `unit` instead, such as m (m/s).
    """
    checked = record(named_tuple)
    checked_new = checked.__new__
    following = {name: q for name, q in quantities(named_tuple).items() if q.unit.startswith("V")}

    @functools.wraps(named_tuple.__new__)
    def __new__(cls: Any, *args: Any, **kwargs: Any) -> Any:
        try:
            given: dict[str, Any] = named_tuple(*args, **kwargs)._asdict()  # type: ignore[attr-defined]
        except TypeError:
            return checked_new(cls, *args, **kwargs)  # raises QuantityError for a missing or unknown field
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
    """Return the class of a waveform that is constructed from fields, such as `Sawtooth`.

    Args:
        text: name of the class, or ``path.py:Name``; the file is then executed.
        folder: folder of the input file that contains the name; None if the user gives the name.

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
        minimum, maximum: limits in the unit of the waveform, or strings with units.

    Raises:
        QuantityError: the waveform exceeds a limit (the message names the value reached and the limit), or a
            limit is not a number.
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
        # An excess by rounding is allowed: 0.1 V + 0.2 V does not exceed 0.3 V.
        if sign * (value - limit) > 1e-12 * abs(limit):
            shown, name = with_prefix(value, unit, 6), type(waveform).__name__
            raise QuantityError(f"{name} reaches {shown}, {words} of {with_prefix(limit, unit, 6)}")
