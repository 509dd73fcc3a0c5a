"""Origin of the values of a model (a record of an actuator or slider): a source, an assumption of the
parameter set, or a change after loading."""

from __future__ import annotations

import math
from operator import attrgetter
from typing import Any

from ..quantities.records import quantities_of
from ..quantities.units import with_prefix
from .load import ParameterSet


def flat(record: Any) -> dict[str, Any]:
    """Return the values of a record (SI) by field, except the field `name`, as one mapping without nesting.

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
    """Return the changes of a record since it was loaded from a parameter set as `original`.

    Returns:
        Mapping from field ("friction.sigma_0") to the text "NEW (in the set: OLD)", both values with units.
    """
    before, now = flat(original), flat(record)
    return {
        field: f"{_shown(record, field)} (in the set: {_shown(original, field)})"
        for field in now
        if not _same(now[field], before.get(field))
    }


def unchanged(record: Any, original: Any, parameters: ParameterSet) -> dict[str, str]:
    """Return the values of a record that have not changed since it was loaded from a parameter set.

    Args:
        record: the record, an actuator or slider.
        original: the record as it was loaded from the set.
        parameters: the set; only fields that its file contains are returned.

    Returns:
        Mapping from field ("friction.sigma_0") to a text with value and unit.
    """
    before, now = flat(original), flat(record)
    return {
        field: _shown(record, field)
        for field in parameters.entries()
        if field in now and _same(now[field], before.get(field))
    }


def assumptions(record: Any, original: Any, parameters: ParameterSet) -> dict[str, str]:
    """Return the values of a record that its parameter set assumes or gives without a source.

    Values that were changed after loading are left out. The arguments are those of `unchanged`.

    Returns:
        Mapping from field ("friction.sigma_0") to a text with value, unit and reason.
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
    # Values that differ only in the last digit are the same, because a unit conversion may change this digit.
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=1e-12)
    return a == b


def _shown(record: Any, field: str) -> str:
    """Return a text with the value of a record's field ("friction.sigma_0") and its unit; "none" for None,
    and "[1 V, 2 V]" for several numbers."""
    value = flat(record).get(field)
    if value is None:
        return "none"
    owner, _, inner = field.rpartition(".")
    spec = quantities_of(attrgetter(owner)(record) if owner else record, record).get(inner)
    values = value if isinstance(value, tuple) else (value,)
    words = [with_prefix(v, spec.unit, 6) if spec and isinstance(v, float) else str(v) for v in values]
    return f"[{', '.join(words)}]" if isinstance(value, tuple) else words[0]
