"""Origin of a record's values: a source, an assumption of the parameter set, or a change after loading."""

from __future__ import annotations

import math
from operator import attrgetter
from typing import Any

from ..quantities.records import quantities_of
from ..quantities.units import with_prefix
from .load import ParameterSet


def flat(record: Any) -> dict[str, Any]:
    """Return the values of a record by field, except its name.

    A nested record gives the name of its type ("friction": "LuGre"), and its fields as "friction.sigma_0".
    """
    values = {}
    for field, value in record._asdict().items():
        if hasattr(value, "_asdict"):
            values[field] = type(value).__name__
            values.update({f"{field}.{inner}": v for inner, v in flat(value).items()})
        elif field != "name":
            values[field] = value
    return values


def changes(record: Any, original: Any) -> dict[str, str]:
    """Return the fields of a record that differ from the `original`, as it was loaded from a parameter set.

    Returns:
        New and old value as a text, by field ("friction.sigma_0").
    """
    before, now = flat(original), flat(record)
    return {
        field: f"{_shown(record, field)} (in the set: {_shown(original, field)})"
        for field in now
        if not _same(now[field], before.get(field))
    }


def unchanged(record: Any, original: Any, parameters: ParameterSet) -> dict[str, str]:
    """Return the values of a parameter set that a record still has.

    Args:
        record: the record.
        original: the record as it was loaded from the set.
        parameters: the set.

    Returns:
        Value with unit as a text, by field ("friction.sigma_0").
    """
    before, now = flat(original), flat(record)
    return {
        field: _shown(record, field)
        for field in parameters.entries()
        if field in now and _same(now[field], before.get(field))
    }


def assumptions(record: Any, original: Any, parameters: ParameterSet) -> dict[str, str]:
    """Return the values of a record that its parameter set assumes or gives without a source.

    A value that was changed after loading no longer counts. The arguments are those of `unchanged`.

    Returns:
        Value with unit, and the reason, as a text, by field ("friction.sigma_0").
    """
    before, now = flat(original), flat(record)
    return {
        field: f"{_shown(record, field)}: {entry.reason or 'no source given'}"
        for field, entry in parameters.entries().items()
        if (entry.assumed or not entry.source) and field in now and _same(now[field], before[field])
    }


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, float) and isinstance(b, float):  # a unit conversion may change the last digit
        return math.isclose(a, b, rel_tol=1e-12)
    return a == b


def _shown(record: Any, field: str) -> str:
    """Return the value of a field ("friction.sigma_0") with its unit, as text; "none" for None."""
    value = flat(record).get(field)
    if value is None:
        return "none"
    owner, _, inner = field.rpartition(".")
    spec = quantities_of(attrgetter(owner)(record) if owner else record, record).get(inner)
    values = value if isinstance(value, tuple) else (value,)
    words = [with_prefix(v, spec.unit, 6) if spec and isinstance(v, float) else str(v) for v in values]
    return f"[{', '.join(words)}]" if isinstance(value, tuple) else words[0]
