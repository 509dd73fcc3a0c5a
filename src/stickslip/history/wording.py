"""Word the differences between runs for a page: readable names instead of keys, and units of the numbers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from ..friction import LuGre
from ..quantities.records import quantities
from ..quantities.units import ANGLE
from ..recording import STANDARD_NAMES
from ..rig.capture import Capture
from ..rig.limits import Limits
from .comparing import flat_rows

_UNITS = {"seconds": "s"} | {
    f"{name}.{field}": one.unit
    for name, kind in (("capture", Capture), ("limits", Limits), ("contact", LuGre))
    for field, one in quantities(kind).items()
}


def worded(found: Mapping[str, Sequence[Any]], rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return differences between rows of the index in words, for a page.

    Args:
        found: lists of values by name, one value per row, from `comparing.differences` of the same rows.
        rows: the compared rows of the index.

    Returns:
        A list with one dictionary for each difference: `what` (its name in words), `values` (one per row) and
        `units` (one per row: the SI unit of a rig's or contact's setting, the unit in the file of a variable,
        or "").
    """
    flat = flat_rows(rows)
    shown = []
    for name, values in found.items():
        if name.endswith(".unit"):
            # A unit is shown with its number, not as a difference.
            continue
        texts = [_plain(value) if name == "channels" else value for value in values]
        shown.append({"what": _words(name), "values": texts, "units": [_unit(name, one) for one in flat]})
    return shown


def _words(name: str) -> str:
    return "length" if name == "seconds" else _plain(name.removesuffix(".value").replace(".", ": "))


def _plain(text: Any) -> Any:
    """Return a text with spaces instead of underscores, except underscores before a number, which belong to a
    symbol (sigma_0); values that are not texts are returned unchanged."""
    return re.sub(r"_(?=[a-z])", " ", text) if isinstance(text, str) else text


def _unit(name: str, row: Mapping[str, Any]) -> str:
    if name in _UNITS:
        return ANGLE.unit(_UNITS[name]) if "rotary=True" in str(row.get("actuator")) else _UNITS[name]
    if name == "capture.trigger.level":
        channel = STANDARD_NAMES.get(str(row.get("capture.trigger.signal")))
        return channel.unit if channel else ""
    return str(row.get(f"{name.rpartition('.')[0]}.unit") or "")
