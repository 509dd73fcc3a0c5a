"""Conversion from the units of files and users to the SI units of a recording."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

from ..quantities.units import LONGEST_UNIT, QuantityError, to_si

# Pattern of angular units, with any prefix, which are converted to rad.
_ANGLE = re.compile(r"\w*?(rad(ian)?s?|deg(ree)?s?|arcsec(ond)?s?|arcmin(ute)?s?|turns?|revolutions?)")
# SI_UNITS are the allowed values of a recording's ``units`` attribute; the last one is for plain numbers.
_MECHANICAL = "s,m,kg,N,m/s,m/s^2,rad/s,rad/s^2,N/m,N s/m,N m,J,Pa,W,m^2,m^3,1/m"
_ELECTRICAL = "V,A,C,F,ohm,H,T,V/s,A/s,m/V,N/V"
SI_UNITS = (*_MECHANICAL.split(","), *_ELECTRICAL.split(","), "K", "Hz", "rad", "")

# Spellings in headers that the unit parser misunderstands ("Nm" as nautical miles) or does not know, and the
# spelling that it understands.
_SPELLINGS = {"Nm": "N m", "Nmm": "N mm", "mNm": "mN m", "-": "", "1": "", "°": "deg"}
_SPELLINGS |= {"Ohm": "ohm", "kOhm": "kohm", "MOhm": "Mohm", "mil": "thou", "mils": "thou"}


# Pattern of a number followed by a unit that does not start with a digit, such as "20 V".
_SCALED = re.compile(r"(?P<number>[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)\s*\*?\s*(?P<unit>[^\d\s.].*)")


class Conversion(NamedTuple):
    """Conversion to SI: ``SI value = factor * value + offset``. `unit` is the SI unit; the offset, in this
    unit, is 0 except for temperatures."""

    unit: str
    factor: float
    offset: float


@cache
def to_si_unit(unit: str) -> Conversion:
    """Return the `Conversion` to SI of numbers in `unit` ("mm", "uN", "degC").

    Raises:
        QuantityError: the unit is not known, or has a dimension that recordings do not have.
    """
    if len(unit) > LONGEST_UNIT:
        raise QuantityError(f"the unit {unit[:LONGEST_UNIT]!r}... is not known here")
    text = _SPELLINGS.get(unit.strip(), unit.strip())
    if text in SI_UNITS:
        return Conversion(text, 1.0, 0.0)
    spellings = [text]
    # Names of units such as "Volts" are also tried in lower case and without "s"; in short symbols, case
    # matters.
    if len(text) > 3 and text.isalpha():
        spellings += [text.lower(), text.lower().rstrip("s")]
    for spelling in spellings:
        for target in _targets(spelling):
            try:
                offset = to_si(f"0 {spelling}", target)
                factor = to_si(f"1 {spelling}", target) - offset
            except QuantityError:
                continue
            return Conversion(target, factor, offset)
    raise QuantityError(f"the unit {unit!r} is not known here")


def to_si_scale(text: str) -> Conversion:
    """Return the `Conversion` to SI for a unit with a number before it: "20 V" for a probe, "0.5 um/V" or
    "2 mdeg/V" for a sensor. The unit may be any unit per volt; one without a number has the number 1.

    Raises:
        QuantityError: see `to_si_unit`; or the number is 0 or not finite, or stands before a temperature.
    """
    found = _SCALED.fullmatch(text.strip())
    if not found:
        return _per_volt(text)
    number, made = float(found["number"]), _per_volt(found["unit"])
    if not 0.0 < abs(number) < float("inf") or made.offset:
        raise QuantityError(f"the scale {text!r} is not a scale: give a number other than 0, and a unit")
    return made._replace(factor=number * made.factor)


def _per_volt(text: str) -> Conversion:
    """Return the conversion of a unit, as `to_si_unit`, also of any known unit over a volt ("mm/s/V"), whose
    dimension recordings need not have."""
    of, _, volt = text.strip().rpartition("/")
    if not of.strip() or not is_unit(volt) or to_si_unit(volt).unit != "V":
        return to_si_unit(text)
    over, per = to_si_unit(of), to_si_unit(volt)
    if over.offset:
        raise QuantityError(f"the scale {text!r} is not a scale: a temperature has another zero")
    return Conversion(f"{over.unit}/V", over.factor / per.factor, 0.0)


def is_number(text: str) -> bool:
    """Return True if a text is a number without a unit, in a form that Python reads."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _targets(unit: str) -> tuple[str, ...]:
    """Return the SI units to which `unit` may be converted, in the order to try. The spelling chooses them,
    because dimensions alone do not distinguish Hz from 1/s, J from N m, or rad from plain numbers."""
    if "hz" in unit.lower():
        return ("Hz",)
    # A joule has the same dimension as a torque.
    if unit.endswith("J"):
        return ("J",)
    if _ANGLE.fullmatch(unit):
        return ("rad",)
    return tuple(target for target in SI_UNITS if target not in ("Hz", "rad"))


def is_unit(text: str, convert: Callable[[str], Conversion] = to_si_unit) -> bool:
    """Return True if the function `convert` accepts the text as a unit, that is, raises no QuantityError."""
    try:
        convert(text)
    except QuantityError:
        return False
    return True
