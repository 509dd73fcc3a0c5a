"""Conversion of values with units, such as "65 V", to floats in SI units, and back to text.

``to_si("65 V", "V")`` is 65.0 and ``to_si("1.399 N/um", "N/m")`` is 1.399e6; a plain number is taken as SI
already. Values are converted where they enter the package, so that all computations use SI numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from decimal import Decimal
from functools import cache, lru_cache
from numbers import Real
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Dataset = TypeVar("Dataset")


class QuantityError(ValueError):
    """Error: a value has the wrong dimension, is out of range, or is no number. The message names the
    field."""


_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|inf(?:inity)?\b|nan\b)", re.ASCII | re.IGNORECASE
)
# Only units of this form are given to pint, because pint evaluates powers: "m^9^9^9^9" would take it for
# ever.
_TERM = r"\(*[A-Za-zµμΩÅ°%_]+(?:(?:\*\*|\^)[+-]?\d{1,2}|⁻?[¹²³⁴])?\)*"
_UNIT = re.compile(rf"1?|(?:1?\s*/\s*)?{_TERM}(?:(?:\s*[/*·⋅.]\s*|\s+){_TERM})*")
LONGEST_UNIT = 60  # largest number of characters of a unit; units in files of instruments have up to 20


@cache
def _registry() -> Any:
    import pint  # slow to import, so only when a unit needs it

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)


@cache
def _units(text: str) -> Any:
    if len(text) > LONGEST_UNIT or _UNIT.fullmatch(text) is None:
        raise QuantityError(f"has no readable unit ({text[:LONGEST_UNIT]!r})")
    written = text.replace("µ", "u").replace("μ", "u")
    try:
        return _registry().parse_units("1" + written if written.startswith("/") else written)
    except Exception as error:  # pint raises a dozen types of errors, also those of Python's tokenizer
        raise QuantityError(f"has the unknown unit '{text}'") from error


def _radians_per_cycle(units: Any, wanted: Any) -> float:
    """Return the factor from `units` to `wanted` (units of pint) that pint omits: 2π from Hz to an angular
    frequency, 1/(2π) back, else 1.

    For pint, Hz and rad/s are both 1/s, so that it would convert "525.7 Hz" to 525.7 rad/s.
    """
    angle = re.compile("radian|degree|turn|revolution")
    if "hertz" in str(units) and angle.search(str(wanted)):
        return 2.0 * math.pi
    if angle.search(str(units)) and "hertz" in str(wanted):
        return 0.5 / math.pi
    return 1.0


_EXPONENTS = {"": 0, "p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "k": 3, "M": 6, "G": 9}


def _prefix_power(unit: str, si_unit: str) -> int | None:
    """Return n if a unit is 10^n SI units, and differs from `si_unit` only by prefixes ("N/um": 6 for "N/m");
    else None.

    This avoids importing pint, which takes a third of a second.
    """
    power, sign = 0, 1
    parts, wanted = re.split(r"([ /])", unit), re.split(r"([ /])", si_unit)
    if len(parts) != len(wanted):
        return None
    for part, target in zip(parts, wanted, strict=True):
        if part == target == "/":
            sign = -1
        if part != target:
            base, own = ("g", 3) if target == "kg" else (target, 0)
            exponent = (
                _EXPONENTS.get(part.removesuffix(base)) if base.isalpha() and part.endswith(base) else None
            )
            if exponent is None:
                return None
            power += sign * (exponent - own)
    return power


@lru_cache(maxsize=1024)
def _parse(text: str, si_unit: str) -> float:
    """Return the number of a text with a unit, converted to `si_unit`; a text without a unit is in `si_unit`
    already.

    Raises:
        QuantityError: the text cannot be read, or has another dimension. The message continues the sentence
            "FIELD = TEXT ...", whose start the caller adds.
    """
    written = _NUMBER.match(text)
    if written is None:
        raise QuantityError("does not start with a number")
    number, unit = float(written[0]), text[written.end() :].strip()
    if re.match(r",\d", unit):
        raise QuantityError("has a decimal comma; write a decimal point")
    if unit in ("", si_unit):
        return number
    power = _prefix_power(unit, si_unit)
    if power is not None and math.isfinite(number):
        return float(Decimal(written[0]).scaleb(power))
    units, wanted = _units(unit), _units(si_unit)
    if units.dimensionality != wanted.dimensionality:
        raise QuantityError(f"has the unit '{unit}', which is no {si_unit or 'plain number'}")
    if not math.isfinite(number):
        return number
    convert = _registry().Quantity
    if convert(0.0, units).to(wanted).magnitude != 0.0:  # a unit whose zero is not 0 in SI, such as °C
        return float(convert(number, units).to(wanted).magnitude)
    factor = convert(1.0, units).to(wanted).magnitude * _radians_per_cycle(units, wanted)
    power = round(math.log10(factor))
    # For a power of ten, shift the decimal point, so that "1.399 N/um" is exactly the float 1.399e6.
    if math.isclose(factor, 10.0**power, rel_tol=1e-12):
        return float(Decimal(written[0]).scaleb(power))
    return float(number * factor)


def to_si(value: float | str, unit: str, field: str = "value") -> float:
    """Return a value as a float in an SI unit.

    Args:
        value: a number (or NumPy scalar), taken to be in `unit` already; a string such as "65 V" or
            "1.399 N/um"; or a scalar of pint or xarray, which is converted if it has a unit. Hz and rad/s are
            converted into each other with the factor 2π.
        unit: the SI unit of the result, "" for a plain number.
        field: name of the value in an error.

    Raises:
        QuantityError: the string cannot be read or has another dimension, or the value is no number (NaN and
            infinity are accepted).
    """
    if type(value) is float:
        return value
    expected = f"(expected {unit or 'a plain number'})"
    if isinstance(value, str):
        try:
            return _parse(value.strip(), unit)
        except QuantityError as error:
            raise QuantityError(f"{field} = {_shortened(value)} {error} {expected}") from None
    if getattr(value, "ndim", None) == 0 and (said := own_unit(value)):
        own: Any = value
        return to_si(f"{float(getattr(own, 'magnitude', own))!r} {said}", unit, field)
    number = value.item() if getattr(value, "ndim", None) == 0 else value  # type: ignore[union-attr]
    if isinstance(number, bool) or not isinstance(number, Real):
        raise QuantityError(f"{field} = {_shortened(value)} is not a number {expected}")
    try:
        return float(number)
    except OverflowError:
        raise QuantityError(f"{field} is too large for a number {expected}") from None


def array_si(values: Any, unit: str, field: str = "values") -> NDArray[np.float64]:
    """Return values as an array of floats in an SI unit, of unchanged shape.

    Args:
        values: numbers, taken to be in `unit` already; an array with a unit of its own, of xarray (the
            attribute `units`) or pint; or strings with units, numbers among them, in lists or arrays.
        unit: the SI unit of the field, "" for plain numbers.
        field: name of the values in an error.

    Raises:
        QuantityError: a value is refused as by `to_si`, or nested lists have unequal lengths.
    """
    own = own_unit(values)
    given: Any = getattr(values, "magnitude", values)
    if isinstance(given, list | tuple):
        rows: list[Any] = [
            array_si(one, unit, field)
            if isinstance(one, list | tuple) or getattr(one, "ndim", 0)
            else to_si(one, unit, field)
            for one in given
        ]
        if len({np.shape(row) for row in rows}) > 1:
            raise QuantityError(f"{field} holds rows of different lengths")
        return np.array(rows, dtype=float)
    array = np.asarray(given)
    if array.dtype.kind not in "iufOU":
        raise QuantityError(
            f"{field} is not of numbers but {array.dtype} (expected {unit or 'plain numbers'})"
        )
    if array.dtype.kind in "OU":  # an array of objects or of strings
        read = [to_si(one, own or unit, field) for one in array.ravel().tolist()]
        array = np.array(read, dtype=float).reshape(array.shape)
    array = array.astype(float)
    if not own:
        return array
    one, zero = to_si(f"1 {own}", unit, field), to_si(f"0 {own}", unit, field)
    return array * (one - zero) + zero


def own_unit(value: Any) -> str:
    """Return the unit of an object of xarray (attribute "units") or pint as text; "" for other objects."""
    return str(getattr(value, "attrs", {}).get("units", "")) or str(getattr(value, "units", ""))


def optional_si(value: float | str | None, unit: str, field: str) -> float | None:
    """Return the value in SI, as `to_si`; None stays None."""
    return None if value is None else to_si(value, unit, field)


def _shortened(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= LONGEST_UNIT else f"{text[:LONGEST_UNIT]}..."


_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_TAKES_PREFIX = re.compile(r"(?:m|s|V|A|N|Hz|W|J|C|rad)(?:[ /]|$)")


def with_prefix(value: float, unit: str, digits: int = 4) -> str:
    """Return a value in an SI unit as text with an SI prefix and `digits` significant digits:
    ``with_prefix(3.2e-7, "m")`` is "320 nm".

    The prefix goes to the first unit ("105.7 nm/V", "1.399 MN/m"); kg and powers get none, rad/s none of
    thousands ("3303 rad/s", but "1.3 mrad/s").
    """
    if value == 0 or not math.isfinite(value) or _TAKES_PREFIX.match(unit) is None:
        return f"{value:.{digits}g} {unit}".strip()
    rounded = f"{value:.{digits - 1}e}"  # round first, because 999.99 nm must become 1 µm, not 1000 nm
    most = 0 if unit == "rad/s" else 9
    exponent = min(max(3 * (int(rounded.partition("e")[2]) // 3), -12), most)
    # At least three digits, as many as are before the decimal point: "130 nm" instead of "1.3e+02 nm".
    return f"{float(rounded) / 10.0**exponent:.{max(digits, 3)}g} {_PREFIXES[exponent]}{unit}"


def near_one(value: float, digits: int = 4) -> str:
    """Return a number, such as a coefficient of determination r², as text with `digits` decimals, or with
    more if it is so close to 1 that these would not show the difference: "0.9999935"."""
    lacking = 1.0 - value
    if 0.0 < lacking < 0.5 * 10.0**-digits:
        digits = max(digits, 1 - math.floor(math.log10(lacking)))
    return f"{value:.{digits}f}"


def with_unit(text: str) -> Any:
    """Return a text such as "0.1 ms" as a quantity of pint, which carries its unit through arithmetic; "1"
    gives a dimensionless one.

    Raises:
        QuantityError: the text cannot be read; the message continues the sentence "FIELD ...".
    """
    written = _NUMBER.match(text.strip())
    if written is None:
        raise QuantityError(f"has {text!r}, which does not start with a number")
    return _registry().Quantity(float(written[0]), _units(text.strip()[written.end() :].strip()))


def same_dimension(quantity: Any, unit: str) -> bool:
    """Return True if a quantity, as `with_unit` returns it, has the dimension of the unit."""
    return quantity.dimensionality == _units(unit).dimensionality


class Coordinate(NamedTuple):
    """Kind of position of a model, length or angle, with the units and words that follow from it: `LENGTH`,
    `ANGLE`.

    `position` is the unit of positions, "m" or "rad". `units` maps units of a linear model to those that
    replace them ("N" to "N m"), and `words` maps words ("force" to "torque"); both are empty for a length.
    """

    position: str
    units: Mapping[str, str]
    words: Mapping[str, str]

    def unit(self, of: str) -> str:
        """Return the unit that replaces a linear model's unit `of`: for an angle "N s/m" is "N m s/rad"."""
        if not self.units or _OF_ANGLES.search(of):
            return of
        over, slash, under = of.partition("/")
        top, bottom = (
            " ".join(self.units.get(one, one) for one in side.split(" ")) for side in (over, under)
        )
        return f"{top}{slash}({bottom})" if " " in bottom else f"{top}{slash}{bottom}"

    def name(self, of: str) -> str:
        """Return the name that replaces a linear model's name: for an angle "friction torque" replaces
        "friction force"."""
        return re.sub("(?:angular )?[a-z]+", lambda word: self.words.get(word[0], word[0]), of)


_OF_ANGLES = re.compile("rad|N m|kg m")
LENGTH = Coordinate("m", {}, {})
ANGLE = Coordinate(
    "rad",
    {"m": "rad", "N": "N m", "kg": "kg m^2"},
    {
        "position": "angle",
        "positions": "angles",
        "displacement": "rotation",
        "velocity": "angular velocity",
        "speed": "angular speed",
        "force": "torque",
        "forces": "torques",
    },
)


def coordinate_of(what: Any) -> Coordinate:
    """Return `ANGLE` for the text "rad", or for an object whose attribute `rotary` is True; else `LENGTH`."""
    rotary = what == ANGLE.position if isinstance(what, str) else getattr(what, "rotary", False)
    return ANGLE if rotary else LENGTH


def refuse_other_coordinate(one: Any, model: Any, field: str) -> None:
    """Raise QuantityError if a record has positions in m and its model in rad, or the reverse.

    Args:
        one: record with a field `rotary`.
        model: actuator or another model; or "m" or "rad", its unit of positions.
        field: argument that has the record, for the message.
    """
    own, wanted = coordinate_of(one), coordinate_of(model)
    if own is not wanted:
        raise QuantityError(
            f"{field} is in {own.position}, but the model moves in {wanted.position}: give "
            f"{type(one).__name__}(..., rotary={wanted is ANGLE}) with values in {wanted.position}"
        )


def unit_for(model: Any, unit: str) -> str:
    """Return the unit of a model's quantity, given the `unit` of this quantity for a linear model: for a
    rotary model and "m", return "rad"."""
    return coordinate_of(model).unit(unit)


def labelled_for(model: Any, made: Dataset) -> Dataset:
    """Change a linear model's data set in place: its units and long names become a rotary model's.

    The data set `made` is returned, unchanged if the model is linear.
    """
    of, labelled = coordinate_of(model), cast("Any", made)
    for variable in labelled.variables.values():
        for key, own in (("units", of.unit), ("long_name", of.name)):
            if key in variable.attrs:
                variable.attrs[key] = own(variable.attrs[key])
    return made
