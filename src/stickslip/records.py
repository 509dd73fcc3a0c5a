"""Frozen records of physical quantities: the only way in which this package holds parameters.

A record is a ``typing.NamedTuple`` whose fields say their unit, symbol, meaning and range. The decorator
`record` makes construction check all of that and accept unit strings. Being a named tuple, the same object
goes into a compiled kernel as it is: there is no second, "fast" copy of any parameter.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeVar, get_type_hints

from .units import QuantityError, to_si

T = TypeVar("T")


class Quantity(NamedTuple):
    """What a field means: put it into the annotation, ``Annotated[float, Quantity("N/m", "σ₀", ...)]``.

    `minimum` and `maximum` are allowed values, `above` and `below` are the limits just outside the range.
    Infinity is refused unless `maximum` is infinite.
    """

    unit: str
    symbol: str
    meaning: str
    minimum: float | None = None
    above: float | None = None
    maximum: float | None = None
    below: float | None = None

    def range_text(self) -> str:
        """The allowed range in words, with the unit."""
        parts = []
        if self.above is not None:
            parts.append(f"> {self.above:g}")
        if self.minimum is not None:
            parts.append(f">= {self.minimum:g}")
        if self.below is not None:
            parts.append(f"< {self.below:g}")
        if self.maximum is not None and math.isfinite(self.maximum):
            parts.append(f"<= {self.maximum:g}")
        return (" and ".join(parts) or "any finite number") + (f" {self.unit}" if self.unit else "")

    def check(self, value: float | str, field: str) -> float:
        """The value in SI.

        Raises:
            QuantityError: wrong dimension, no number, NaN, or out of range; names field, unit and range.
        """
        number = to_si(value, self.unit, field)
        infinite_allowed = self.maximum is not None and math.isinf(self.maximum) and number > 0
        ok = math.isfinite(number) or (math.isinf(number) and infinite_allowed)
        ok = ok and (self.minimum is None or number >= self.minimum)
        ok = ok and (self.above is None or number > self.above)
        ok = ok and (self.maximum is None or number <= self.maximum)
        ok = ok and (self.below is None or number < self.below)
        if not ok:
            shown = f"{value!r}" if isinstance(value, str) else f"{number:g} {self.unit}".strip()
            raise QuantityError(f"{field} = {shown} is out of range: {self.meaning} must be {self.range_text()}")
        return number


def quantities(record_type: type) -> dict[str, Quantity]:
    """The `Quantity` of each field that has one, in order of the fields."""
    found = {}
    for name, hint in get_type_hints(record_type, include_extras=True).items():
        for extra in getattr(hint, "__metadata__", ()):
            if isinstance(extra, Quantity):
                found[name] = extra
    return found


def record(named_tuple: type[T]) -> type[T]:
    """Make construction of a ``NamedTuple`` check every `Quantity` and run the class's ``_check``, if any.

    Tuples in a `Quantity` field (the elements of a Maxwell-slip law, say) are checked one by one.
    """
    specs = quantities(named_tuple)
    fields = named_tuple._fields  # type: ignore[attr-defined]
    plain_new = named_tuple.__new__

    def __new__(cls: Any, *args: Any, **kwargs: Any) -> Any:
        unknown = [name for name in kwargs if name not in fields]
        if unknown:
            raise QuantityError(f"{cls.__name__} has no field {unknown[0]!r}; it has {', '.join(fields)}")
        try:
            raw = plain_new(cls, *args, **kwargs)
        except TypeError as error:
            raise QuantityError(f"{cls.__name__}: {str(error).removeprefix('__new__() ')}") from None
        values = []
        for name, value in zip(fields, raw, strict=True):
            if name in specs and value is not None:
                label = f"{cls.__name__}.{name}"
                if isinstance(value, tuple | list):
                    value = tuple(specs[name].check(v, f"{label}[{i}]") for i, v in enumerate(value))
                else:
                    value = specs[name].check(value, label)
            values.append(value)
        made = tuple.__new__(cls, values)
        check = getattr(made, "_check", None)
        if check is not None:
            check()
        return made

    def _replace(self: Any, **changes: Any) -> Any:
        return type(self)(**{**self._asdict(), **changes})

    def __eq__(self: Any, other: object) -> bool:
        return type(self) is type(other) and tuple.__eq__(self, other)  # type: ignore[arg-type]

    namespace = {
        "__slots__": (),
        "__new__": __new__,
        "_replace": _replace,
        "__eq__": __eq__,
        "__hash__": lambda self: hash((type(self).__name__, tuple(self))),
        "__doc__": named_tuple.__doc__,
        "__module__": named_tuple.__module__,
        "__qualname__": named_tuple.__qualname__,
    }
    return type(named_tuple.__name__, (named_tuple,), namespace)  # type: ignore[return-value]
