"""Writing of an actuator or pulled slider as a parameter set (TOML), from which the same record is loaded."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ..quantities import registry
from ..quantities.records import quantities_of
from .load import PIEZO_PARTS, ParameterSetError, load_set


def parameter_text(
    record: Any,
    title: str,
    source: str,
    errors: Mapping[str, float] | None = None,
    kind: str = "actuator",
    *,
    assumed: Mapping[str, str] | None = None,
) -> str:
    """Return the TOML text of a parameter set with the values of a record.

    The text contains friction law, piezo models, further modes and normal force of the record, but no
    citations. Fields that are None or infinite are left out.

    Args:
        record: an actuator, or another record with a friction law, with numbers in SI.
        title: title of the set.
        source: origin of the values, which becomes the `source` of each value.
        errors: standard errors in SI by name of the field ("sigma_0", without "friction."); each becomes the
            `note` of its value.
        kind: kind of the set, "actuator" or "pulled_slider".
        assumed: reason of each of the record's own fields that is assumed, by name; such a value has no
            `source`.
    """
    law = registry.laws.name_of(type(record.friction))
    lines = [f"title = {_text(title)}", "citations = []", f"kind = {_text(kind)}", ""]
    lines += _tables(record, "", source, errors or {}, assumed=assumed or {})
    lines += ["[friction]", f"law = {_text(law)}", ""]
    lines += _tables(record.friction, "friction.", source, errors or {}, record)
    piezo = getattr(record, "piezo", None)
    for name in PIEZO_PARTS:
        part = getattr(piezo, name, None)
        if part is not None:
            lines += [f"[piezo.{name}]", f"model = {_text(registry.piezos.name_of(type(part)))}", ""]
            lines += _tables(part, f"piezo.{name}.", source, {}, record)
    for name in ("further_modes", "normal_force"):
        if getattr(record, name, None) is not None:
            lines += _tables(getattr(record, name), f"{name}.", source, {}, record)
    return "\n".join(lines)


def _tables(
    record: Any,
    prefix: str,
    source: str,
    errors: Mapping[str, float],
    owner: Any = None,
    assumed: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[str]:
    known = quantities_of(record, owner)
    for field, value in record._asdict().items():
        # The value false of the flag `rotary` is the default and is not written.
        if field == "rotary" and not value:
            continue
        if isinstance(value, bool):
            shown, unit, symbol = str(value).lower(), None, ""
        elif field in known and _finite(value):
            shown = repr([float(one) for one in value]) if isinstance(value, tuple) else repr(float(value))
            unit, symbol = known[field].unit, known[field].symbol
        # The field is not a value of this table: a name, a part with tables of its own, or a default (None,
        # infinite).
        else:
            continue
        yield f"[{prefix}{field}]"
        yield f"value = {shown}"
        if unit is not None:
            yield f"unit = {_text(unit)}"
            yield f"symbol = {_text(symbol)}"
        if field in assumed:
            yield f"assumed = true\nreason = {_text(assumed[field])}"
        else:
            yield f"source = {_text(source)}"
        if field in errors and math.isfinite(errors[field]):
            yield f"note = {_text(f'standard error {errors[field]:.3g} {unit}'.strip())}"
        yield ""


def _finite(value: Any) -> bool:
    values = value if isinstance(value, tuple) else (value,)
    return value != () and all(isinstance(one, int | float) and math.isfinite(one) for one in values)


def _text(text: str) -> str:
    # A text in TOML is quoted and escaped as in JSON.
    return json.dumps(text, ensure_ascii=False)


def write_parameters(path: str | os.PathLike[str], text: str) -> Path:
    """Write the text of a parameter set to a new file, read the file as a check, and return its path. Missing
    folders are made.

    Raises:
        FileExistsError: a file with that name exists.
        OSError: the file cannot be written.
        ParameterSetError: the text is not a valid parameter set. The new file is removed again.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise
    # The error of a full disk does not name the file, so the path is added; the incomplete file is removed.
    except OSError as error:
        path.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error
    try:
        load_set(path)
    except ParameterSetError:
        path.unlink(missing_ok=True)
        raise
    return path
