"""Unit strings at the edge, SI floats inside.

``to_si("65 V", "V")`` is 65.0 and ``to_si("1.399 N/um", "N/m")`` is 1.399e6; a plain number is taken as SI
already. Nothing below this module ever sees a unit.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any


class QuantityError(ValueError):
    """A value is of the wrong dimension, out of range, or no number. The message names field and unit."""


@cache
def _registry() -> Any:
    import pint  # 0.2 s to import: only for those who write unit strings

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)


@cache
def _parse(text: str, unit: str) -> float:
    import pint

    quantity = _registry().Quantity(text.replace("µ", "u").replace("μ", "u"))
    if quantity.units == _registry().dimensionless and unit not in ("", "1") and _is_plain_number(text):
        return float(quantity.magnitude)
    try:
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError as error:
        raise QuantityError(f"has the unit '{quantity.units:~}', which is no {unit or 'plain number'}") from error


def _is_plain_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def to_si(value: float | str, unit: str, field: str = "value") -> float:
    """The value as a float in `unit` (an SI unit).

    Args:
        value: a number, taken to be in `unit` already, or a string such as "65 V" or "1.399 N/um".
        unit: the SI unit of the field, "" for a plain number.
        field: what to call the value in an error.

    Raises:
        QuantityError: the string cannot be read, or is of another dimension, or is no number.
    """
    shown = unit or "a plain number"
    if isinstance(value, str):
        try:
            return _parse(value.strip(), unit)
        except QuantityError as error:
            raise QuantityError(f"{field} = {value!r} {error} (expected {shown})") from None
        except Exception as error:  # pint raises a dozen kinds, tokenizer errors among them
            raise QuantityError(f"{field} = {value!r} is not a quantity in {shown}") from error
    if isinstance(value, bool):
        raise QuantityError(f"{field} = {value!r} is not a number (expected {shown})")
    try:
        return float(value)
    except (TypeError, ValueError):
        raise QuantityError(f"{field} = {value!r} is not a number (expected {shown})") from None


_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def with_prefix(value: float, unit: str, digits: int = 4) -> str:
    """The value for people to read: ``with_prefix(3.2e-7, "m")`` is "320 nm"."""
    simple = unit in ("m", "s", "V", "N", "Hz", "N/m", "W", "J")
    if value == 0 or not math.isfinite(value) or not simple:
        return f"{value:.{digits}g} {unit}".strip()
    exponent = min(max(3 * math.floor(math.log10(abs(value)) / 3), -12), 9)
    return f"{value / 10.0**exponent:.{digits}g} {_PREFIXES[exponent]}{unit}"
