"""Records: immutable sets of physical quantities, in which this package keeps all parameters.

A record is a ``typing.NamedTuple`` whose fields declare unit, symbol, meaning and range. The decorator
`record` makes construction check the values and accept texts with units. The engine takes the same named
tuple, so that there is no second, "fast" copy of any parameter.
"""

from __future__ import annotations

import functools
import html
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from types import MethodType, NoneType
from typing import Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from .units import ANGLE, Coordinate, QuantityError, coordinate_of, to_si, with_prefix

T = TypeVar("T")

# Largest number of numbers that one call may keep: 1.6 GB in double precision, a fifth of 8 GB.
MOST_NUMBERS = 200_000_000

# Words for the allowed values of a type, for error messages.
_PLAIN: dict[Any, str] = {bool: "True or False", str: "a text", NoneType: "None"}


class Quantity(NamedTuple):
    """Unit, symbol, meaning and range of a record's field: ``Annotated[float, Quantity("N/m", "σ₀", ...)]``.

    `unit` is the SI unit for a linear actuator. `minimum` and `maximum` are the least and greatest allowed
    values; values must be greater than `above` and less than `below`. Bounds are in the SI unit; None is no
    bound. Infinity is refused unless it is the `maximum` (-infinity: the `minimum`).
    """

    unit: str
    symbol: str
    meaning: str
    minimum: float | None = None
    above: float | None = None
    maximum: float | None = None
    below: float | None = None

    def along(self, coordinate: Coordinate) -> Quantity:
        """Return the same quantity with the unit for a coordinate (`LENGTH`, `ANGLE`): for `ANGLE`, m becomes
        rad. The bounds are not changed."""
        return self._replace(unit=coordinate.unit(self.unit))

    def range_text(self) -> str:
        """Return the allowed range as text with the unit, such as "> 0 and <= 100 V"."""
        limits = ((">", self.above), (">=", self.minimum), ("<", self.below), ("<=", self.maximum))
        parts = [f"{sign} {limit:g}" for sign, limit in limits if limit is not None and math.isfinite(limit)]
        if parts:
            return f"{' and '.join(parts)} {self.unit}".strip()
        return f"a finite number in {self.unit}" if self.unit else "a finite number"

    def allows(self, values: Any) -> Any:
        """Return True for each number in SI that is in range: a boolean, or an array of the same shape."""
        ok = math.isfinite(values) if isinstance(values, float) else np.isfinite(values)
        if self.minimum is not None:
            ok = (ok | (values == self.minimum)) & (values >= self.minimum)
        if self.maximum is not None:
            ok = (ok | (values == self.maximum)) & (values <= self.maximum)
        if self.above is not None:
            ok = ok & (values > self.above)
        return ok if self.below is None else ok & (values < self.below)

    def check(self, value: Any, field: str) -> float:
        """Return a value in SI units after checking it.

        Args:
            value: a number in SI, or a text with a unit.
            field: name of the field, for errors.

        Raises:
            QuantityError: wrong dimension, no number, NaN, or out of range; names field, unit and range.
        """
        try:
            number = to_si(value, self.unit, field)
        except QuantityError as error:
            raise QuantityError(f"{error}: {self.meaning} must be {self.range_text()}") from None
        if not self.allows(number):
            shown = repr(value) if isinstance(value, str) else f"{number:.12g} {self.unit}".strip()
            endless = math.inf in (self.maximum, -(self.minimum or 0.0))  # True if infinity is in range
            wrong = "out of range" if endless or math.isfinite(number) else "not finite"
            raise QuantityError(f"{field} = {shown} is {wrong}: {self.meaning} must be {self.range_text()}")
        return number


DURATION = Quantity("s", "T", "duration", above=0)
SAMPLE_RATE = Quantity("Hz", "f_s", "samples per second", above=0)


class Field(NamedTuple):
    """Declaration of a record's field: its `Quantity`, and whether it may be None or a tuple of values."""

    quantity: Quantity
    optional: bool  # True if None is allowed
    sequence: bool  # True if the field is a tuple of values, each of which is checked

    def check(self, value: Any, label: str) -> Any:
        if value is None and self.optional:
            return None
        if not self.sequence:
            return self.quantity.check(value, label)
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise QuantityError(
                f"{label} = {value!r} must be a list, each value {self.quantity.range_text()}"
            )
        return tuple(self.quantity.check(v, f"{label}[{i}]") for i, v in enumerate(value))


@functools.cache
def fields_with_quantity(record_type: type) -> dict[str, Field]:
    """Return the declaration of each field of a record type that has a `Quantity`, by name, in order."""
    found = {}
    for name, hint in get_type_hints(record_type, include_extras=True).items():
        for extra in getattr(hint, "__metadata__", ()):
            if isinstance(extra, Quantity):
                kinds = (hint.__origin__, *get_args(hint.__origin__))
                sequence = any(get_origin(kind) is tuple for kind in kinds)
                found[name] = Field(extra, NoneType in kinds, sequence)
    return found


@functools.cache
def _kinds(record_type: type) -> dict[str, Any]:
    """Return the annotation of each field that allows only booleans, texts, records or None, by name."""

    def known(kind: Any) -> bool:
        return kind in _PLAIN or hasattr(kind, "_fields")

    hints = get_type_hints(record_type)
    return {name: kind for name, kind in hints.items() if all(map(known, get_args(kind) or (kind,)))}


def quantities(record_type: type) -> dict[str, Quantity]:
    """Return the `Quantity` of each field of a record type that has one, by name, in order of the fields."""
    return {name: field.quantity for name, field in fields_with_quantity(record_type).items()}


def quantities_of(one: Any, owner: Any = None) -> dict[str, Quantity]:
    """Return the `Quantity` of each field of a record that has one, by name.

    Args:
        one: the record.
        owner: record to which it belongs, such as the actuator of a friction law. If the owner (by default
            the record) is `rotary`, the units are those of rotation.
    """
    of = coordinate_of(one if owner is None else owner)
    return {name: quantity.along(of) for name, quantity in quantities(type(one)).items()}


def quantities_within(model: Any) -> dict[str, Quantity]:
    """Return the `Quantity` of each field of a model and of its friction law, by name of the field."""
    return quantities_of(model) | quantities_of(model.friction, model)


def sequences(record_type: type) -> frozenset[str]:
    """Return the names of a record type's fields that are tuples of values with a `Quantity`."""
    return frozenset(name for name, field in fields_with_quantity(record_type).items() if field.sequence)


def of_kind(value: Any, kind: Any, field: str) -> Any:
    """Return the value if it is of an allowed kind, else raise QuantityError naming the field.

    Args:
        value: value of the field.
        kind: a type, or a union (``LowPass | None``).
        field: name of the field.
    """
    if isinstance(value, kind):
        return value
    names = [_PLAIN.get(one, str(one.__name__)) for one in get_args(kind) or (kind,)]
    raise QuantityError(f"{field} = {value!r:.60} must be {' or '.join(names)}")


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a hint for an error about an unknown word: " (did you mean 'NAME'?)"; "" if no name is similar.

    Args:
        word: the unknown word.
        known: the known names.
    """
    close = get_close_matches(word, list(known), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _bind(
    record_type: Any, args: tuple[Any, ...], kwargs: dict[str, Any], specs: dict[str, Field]
) -> list[Any]:
    """Return the value of each field of a record, in order, from arguments of its constructor and defaults.

    The values are not checked. Errors name the fields, unlike those of Python.

    Args:
        record_type: class of the record.
        args, kwargs: arguments by position and by name.
        specs: fields that have a `Quantity`, by name; the message about a missing field gives meaning and
            range.

    Raises:
        QuantityError: an argument is missing, unknown, given twice or one too many.
    """
    owner, fields = record_type.__name__, record_type._fields
    if len(args) > len(fields):
        raise QuantityError(
            f"{owner} has {len(fields)} fields ({', '.join(fields)}), {len(args)} values were given"
        )
    given = dict(zip(fields, args, strict=False))
    for name in kwargs:
        if name not in fields:
            raise QuantityError(
                f"{owner} has no field {name!r}{did_you_mean(name, fields)}; it has {', '.join(fields)}"
            )
        if name in given:
            raise QuantityError(f"{owner}.{name} is given twice")
    given = {**record_type._field_defaults, **given, **kwargs}
    for name in fields:
        if name not in given:
            quantity = specs[name].quantity if name in specs else None
            what = f" ({quantity.meaning}, {quantity.range_text()})" if quantity else ""
            raise QuantityError(f"{owner}.{name} is missing{what}")
    return [given[name] for name in fields]


def _as_text(self: Any, owner: Any = None) -> str:
    """Return a record as text in one line, with units. ``repr`` shows SI numbers with all digits instead.

    `owner` is the record to which this one belongs, see `quantities_of`; it determines the units.
    """
    known, parts = quantities_of(self, owner), []
    for name, value in self._asdict().items():
        quantity = known.get(name)
        several = value if isinstance(value, tuple) else (value,)
        if hasattr(value, "_asdict"):
            shown = _as_text(value, self if owner is None else owner)
        elif quantity is None or not all(isinstance(one, int | float) for one in several):
            shown = str(value)
        else:
            shown = ", ".join(with_prefix(one, quantity.unit, 6) for one in several)
            shown = f"({shown})" if isinstance(value, tuple) else shown
        parts.append(f"{name}={shown}")
    return f"{type(self).__name__}({', '.join(parts)})"


def _as_html(self: Any) -> str:
    """Return an HTML table of the fields of a record, and of the records in it, for a notebook."""
    return f"<table><caption>{type(self).__name__}</caption>{''.join(_rows(self, self))}</table>"


def _rows(one: Any, owner: Any) -> Iterator[str]:
    known = quantities_of(one, owner)
    for name, value in one._asdict().items():
        quantity = known.get(name)
        if hasattr(value, "_asdict"):
            yield f"<tr><th colspan=3>{name}: {type(value).__name__}</th></tr>"
            yield from _rows(value, owner)
        elif quantity is None:
            yield f"<tr><td>{name}</td><td>{html.escape(str(value))}</td><td></td></tr>"
        else:
            several = value if isinstance(value, tuple) else (value,)
            shown = ", ".join("-" if v is None else with_prefix(v, quantity.unit, 6) for v in several)
            yield f"<tr><td>{name}</td><td>{shown}</td><td>{quantity.symbol} {quantity.meaning}</td></tr>"


def record(named_tuple: type[T]) -> type[T]:
    """Decorate a ``NamedTuple`` so that its construction checks all values and converts texts with units.

    Checked are the range of each `Quantity`, the type of texts, booleans and nested records, and what the
    class's method ``_check``, if there is one, checks. A field annotated as a tuple takes any list, each
    value of which is checked; None is accepted only if the annotation allows it. A record with ``rotary =
    True`` has its quantities in units of rotation. Records of different types are never equal.
    """
    specs, kinds = fields_with_quantity(named_tuple), _kinds(named_tuple)
    of_angles = {name: spec._replace(quantity=spec.quantity.along(ANGLE)) for name, spec in specs.items()}
    plain_new = named_tuple.__new__

    def __new__(cls: Any, *args: Any, **kwargs: Any) -> Any:
        values = dict(zip(cls._fields, _bind(cls, args, kwargs, specs), strict=True))
        known = of_angles if values.get("rotary") is True else specs
        checked = (known[n].check(v, f"{cls.__name__}.{n}") if n in known else v for n, v in values.items())
        made = tuple.__new__(cls, checked)
        for name, kind in kinds.items():
            of_kind(values[name], kind, f"{cls.__name__}.{name}")
        check = getattr(made, "_check", None)
        if check is not None:
            check()
        return made

    __new__.__wrapped__ = plain_new  # type: ignore[attr-defined]  # gives help() and Numba the signature

    def _replace(self: Any, **changes: Any) -> Any:
        return type(self)(**{**self._asdict(), **changes})

    def _make(cls: Any, iterable: Iterable[Any]) -> Any:
        return cls(*iterable)

    def __eq__(self: Any, other: object) -> bool:
        return type(self) is type(other) and tuple.__eq__(self, other)  # type: ignore[arg-type]

    def __ne__(self: Any, other: object) -> bool:
        return not self == other  # tuple's own __ne__ would compare only values: a Dahl might equal a LuGre

    namespace = {
        "__slots__": (),
        "__str__": _as_text,
        "_repr_html_": _as_html,
        "__new__": __new__,
        "_make": classmethod(_make),
        "_replace": _replace,
        "__replace__": _replace,
        "__eq__": __eq__,
        "__ne__": __ne__,
        "__hash__": lambda self: hash((type(self).__name__, tuple(self))),
        "__doc__": named_tuple.__doc__,
        "__module__": named_tuple.__module__,
        "__qualname__": named_tuple.__qualname__,
    }
    return type(named_tuple.__name__, (named_tuple,), namespace)  # type: ignore[return-value]


def whole(value: Any, field: str, least: int, most: int) -> int:
    """Return a value as a Python integer after checking it.

    Args:
        value: whole number of any numeric type, such as 3.0.
        field: name of the value, for the error.
        least, most: least and greatest allowed value.

    Raises:
        QuantityError: the value is not whole, or out of range.
    """
    number = math.nan if isinstance(value, str) else to_si(value, "", field)
    if not least <= number <= most or number % 1:
        raise QuantityError(
            f"{field} = {value!r:.60} is out of range: it must be a whole number, {least} to {most:,}"
        )
    return int(number)


def refuse_too_many(samples: float, what: str, numbers: int = 10) -> None:
    """Raise QuantityError if a call would keep more numbers than fit into memory.

    Args:
        samples: number of samples; inf or NaN counts as too many.
        what: arguments that lead to the number of samples, with their values, for the message.
        numbers: how many numbers are kept for each sample.
    """
    most = MOST_NUMBERS // max(numbers, 1)
    if not samples <= most:
        raise QuantityError(
            f"{what}: that makes {samples:,.0f} samples, and one call keeps at most {most:,}. "
            "Ask for fewer: a lower rate, or a shorter time"
        )


def same(one: Any, other: Any) -> bool:
    """Return True if two results have equal contents.

    Records, data classes, dictionaries, lists, arrays and data sets are compared by value, where NaN equals
    NaN, and bound methods by their object and function.
    """
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind in "fc")
    if isinstance(one, float) and isinstance(other, float):  # true for NumPy's float64, too
        return one == other or (one != one and other != other)
    if type(one) is not type(other):
        return False
    if identical := getattr(one, "identical", None):
        return bool(identical(other))
    if is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in fields(one))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, MethodType):
        return one.__func__ is other.__func__ and same(one.__self__, other.__self__)
    return bool(one == other)


def numbers_in(value: Any) -> Iterator[Any]:
    """Yield all values of a record and of the records and tuples in it, in order, without None."""
    if isinstance(value, tuple):
        for inner in value:
            yield from numbers_in(inner)
    elif value is not None:
        yield value


def with_numbers(value: Any, numbers: Iterator[float]) -> Any:
    """Return a copy of a record with the next `numbers`, in the order of `numbers_in`, without checks."""
    if isinstance(value, tuple):
        return tuple.__new__(type(value), [with_numbers(inner, numbers) for inner in value])
    return None if value is None else next(numbers)
