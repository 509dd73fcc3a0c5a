"""Unit strings at the edge: what is read, what is refused, and how numbers are shown."""

from __future__ import annotations

import math
import pickle
import re
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pint
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from stickslip.quantities.units import QuantityError, array_si, near_one, to_si, with_prefix

READ = [
    ("65 V", "V", 65.0), ("65V", "V", 65.0), ("  65   V  ", "V", 65.0), ("65", "V", 65.0),
    ("-6.5e1 V", "V", -65.0), ("65000 mV", "V", 65.0), (".5 kV", "V", 500.0), ("1.399 N/um", "N/m", 1.399e6),
    ("1399 N/mm", "N/m", 1.399e6), ("0.0349 N s/mm", "N s/m", 34.9), ("34.9 N*s/m", "N s/m", 34.9),
    ("34.9 N·s/m", "N s/m", 34.9), ("34.9 N/(m/s)", "N s/m", 34.9), ("0.3303 rad/ms", "rad/s", 330.3),
    ("17 um", "m", 17e-6), ("17 µm", "m", 17e-6), ("17 μm", "m", 17e-6), ("17 micrometer", "m", 17e-6),
    ("9.81 m/s^2", "m/s^2", 9.81), ("9.81 m/s**2", "m/s^2", 9.81), ("9.81 m/s²", "m/s^2", 9.81),
    ("9.81 m s⁻²", "m/s^2", 9.81), ("5 /s", "1/s", 5.0), ("5 1/s", "1/s", 5.0), ("98.2 g", "kg", 0.0982),
    ("52.4 %", "", 0.524), ("0.524", "", 0.524), ("20 degC", "K", 293.15), ("inf rad/s", "rad/s", math.inf),
    ("-inf V", "V", -math.inf),
]  # fmt: skip


FACTORS = [
    ("525.7 Hz", "rad/s", 2 * math.pi * 525.7), ("0.5257 kHz", "rad/s", 2 * math.pi * 525.7),
    ("3303.1 rad/s", "Hz", 3303.1 / (2 * math.pi)), ("3000 rpm", "Hz", 50.0),
    ("3000 rpm", "rad/s", 100 * math.pi), ("180 deg/s", "rad/s", math.pi), ("5 kHz", "Hz", 5000.0),
    ("30 deg", "rad", math.pi / 6), ("1 kgf", "N", 9.80665), ("1 inch", "m", 0.0254),
]  # fmt: skip


def test_reads() -> None:
    for text, unit, expected in READ:  # exactly: a power of ten moves the decimal point and nothing else
        assert to_si(text, unit) == expected, text
    for text, unit, expected in FACTORS:
        assert to_si(text, unit) == pytest.approx(expected, rel=1e-14), text
    for number in (65, 65.0, np.float32(65), np.int16(65), np.array(65.0), xr.DataArray(65.0), Fraction(65)):
        value = to_si(number, "V")  # type: ignore[arg-type]
        assert value == 65.0
        assert type(value) is float


ARRAYS = {
    "numbers": [20.0, 40],
    "strings": ["20 ms", "0.04 s"],
    "both": ["20 ms", 0.04e3],
    "array of strings": np.array(["20 ms", "40 ms"]),
    "objects": np.array(["20 ms", 40.0], dtype=object),
    "labelled": xr.DataArray([20.0, 40.0], attrs={"units": "ms"}),
    "labelled integers": xr.DataArray([20, 40], attrs={"units": "ms"}),
    "labelled strings": xr.DataArray(np.array(["20 ms", "40"], dtype=object), attrs={"units": "ms"}),
    "pint": pint.UnitRegistry().Quantity(np.array([20.0, 40.0]), "ms"),
    "labelled one by one": [xr.DataArray(20.0, attrs={"units": "ms"}), xr.DataArray(0.04)],
}


def test_arrays_have_units_as_single_numbers_do() -> None:
    other = {"numbers": [20.0, 40.0], "both": [0.02, 40.0], "objects": [0.02, 40.0]}
    for name, values in ARRAYS.items():
        found = array_si(values, "s", "times")
        assert found.dtype == np.float64
        assert found.tolist() == other.get(name, [0.02, 0.04]), name


def test_arrays_keep_their_shape() -> None:
    assert array_si([["1 mV", 2.0], [3, "4 V"]], "V").tolist() == [[1e-3, 2.0], [3.0, 4.0]]
    assert array_si("65 mV", "V").shape == ()
    assert array_si([], "V").shape == (0,)
    warm = xr.DataArray([[20.0], [-273.15]], attrs={"units": "degC"})
    assert array_si(warm, "K") == pytest.approx(np.array([[293.15], [0.0]]))


def test_arrays_that_are_refused() -> None:
    for values, reason in (
        (xr.DataArray([1.0], attrs={"units": "mV"}), "'1 mV' has the unit 'mV', which is no N"),
        (["1 N", "1 mV"], "'1 mV' has the unit 'mV', which is no N"),
        (np.array(["1 N", "much"]), "'much' does not start with a number"),
        (np.array([True]), "is not of numbers but bool"),
        (np.array([1j]), "is not of numbers but complex"),
        (np.array([1], dtype="timedelta64[ns]"), "is not of numbers but timedelta64"),
        ([None, 1.0], "None is not a number"),
        ([[1.0], [1.0, 2.0]], "rows of different lengths"),
    ):
        with pytest.raises(QuantityError, match=f"^force.*{re.escape(reason)}"):
            array_si(values, "N", "force")


REFUSED = [
    ("65 A", "unit 'A', which is no V"), ("65 V/m", "unit 'V/m', which is no V"),
    ("65 %", "unit '%', which is no V"), ("65 volts please", "unknown unit 'volts please'"),
    ("65 foo", "unknown unit 'foo'"), ("", "does not start with a number"),
    ("   ", "does not start with a number"), ("V", "does not start with a number"),
    ("about 65 V", "does not start with a number"), ("0,5 V", "decimal comma"),
    ("6 5 V", "no readable unit"), ("1_000 V", "no readable unit"), ("65 V; 66 V", "no readable unit"),
    ("65 V^9^9^9^9^9^9", "no readable unit"), ("65 (V^9)^9", "no readable unit"),
    ("65 V**99999999", "no readable unit"), ("65 __import__('os').getcwd()", "no readable unit"),
    ("65 " + "V" * 1000, "no readable unit"), ("65 \x00", "no readable unit"), ("65 (V", "unknown unit"),
    (True, "is not a number"), (np.bool_(True), "is not a number"), (None, "is not a number"),
    (b"65", "is not a number"), ([65.0], "is not a number"), (np.array([65.0]), "is not a number"),
    (65 + 0j, "is not a number"), (Decimal(65), "is not a number"), (10**400, "too large"),
]  # fmt: skip


def test_refuses() -> None:
    for value, reason in REFUSED:
        with pytest.raises(QuantityError) as caught:
            to_si(value, "V", "Sawtooth.amplitude")  # type: ignore[arg-type]
        message = str(caught.value)
        assert message.startswith("Sawtooth.amplitude ")
        assert reason in message
        assert "(expected V)" in message
        assert len(message) < 250
    with pytest.raises(QuantityError, match=r"damping = '0\.5 V' .* no plain number"):
        to_si("0.5 V", "", "damping")


def test_the_error_survives_a_process_pool() -> None:
    error = pickle.loads(pickle.dumps(QuantityError("x = 1 V is out of range")))
    assert isinstance(error, ValueError)
    assert str(error) == "x = 1 V is out of range"


def outcome(text: str, unit: str) -> float | str:
    """The number read, or what the refusal says; anything else that is raised fails the test."""
    try:
        return to_si(text, unit, "x")
    except QuantityError as error:
        return str(error)


@given(st.text(max_size=80))
def test_any_text_is_read_or_refused(text: str) -> None:
    found = outcome(text, "V")
    assert isinstance(found, float) or found.startswith("x = ")


@given(st.text(alphabet="0123456789.eE+-*/^() VAmsNukgHz%µ²", max_size=40))
def test_any_text_that_looks_like_a_quantity_is_read_or_refused(text: str) -> None:
    found = outcome("1 " + text, "N s/m")
    assert isinstance(found, float) or "(expected N s/m)" in found


@given(
    st.floats(-1e12, 1e12),
    st.sampled_from([("p", -12), ("n", -9), ("u", -6), ("µ", -6), ("m", -3), ("", 0), ("k", 3), ("M", 6)]),
)
def test_prefixes_only_move_the_decimal_point(number: float, prefix: tuple[str, int]) -> None:
    letter, power = prefix
    assert to_si(f"{number!r} {letter}V", "V") == float(Decimal(repr(number)).scaleb(power))


def test_pint_is_imported_with_the_first_foreign_unit_only() -> None:
    program = (
        "import sys; from stickslip.quantities.units import to_si, with_prefix\n"
        "to_si(65, 'V'); to_si('65', 'V'); to_si('65 V', 'V'); with_prefix(1e-9, 'm')\n"
        "to_si('1.4 N/um', 'N/m'); to_si('5 g', 'kg')\n"
        "print('pint' in sys.modules); to_si('1 lbf', 'N'); print('pint' in sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "True"]


PREFIXES = ("", "p", "n", "u", "µ", "m", "k", "M", "G")


@pytest.mark.parametrize("unit", ["N/m", "m/V", "V", "Hz", "N s/m", "kg", "1/s", "V/s", "m/s"])
def test_prefixed_units_are_those_of_pint(unit: str) -> None:
    """What is read without pint, for its slow import, is what pint reads."""
    plain = "g" if unit == "kg" else unit
    parts = ("m", "s", "V", "g", "N", "Hz")
    units = {re.sub(rf"\b{part}\b", prefix + part, plain) for part in parts for prefix in PREFIXES}
    registry = pint.UnitRegistry()
    for written in units:
        expected = registry.Quantity(3.0, written).to(unit).magnitude
        assert to_si(f"3 {written}", unit) == pytest.approx(expected, rel=1e-12), written


# A kg has its prefix already; a prefix of m^2 would be squared.
SHOWN = [
    (3.2e-7, "m", "320 nm"), (25.565959e-6, "m", "25.57 µm"), (-1.5e-3, "s", "-1.5 ms"), (1e-3, "s", "1 ms"),
    (1e-6, "m", "1 µm"), (999.96e-9, "m", "1 µm"), (999.94e-9, "m", "999.9 nm"), (65.0, "V", "65 V"),
    (1.399e6, "N/m", "1.399 MN/m"), (34.9, "N s/m", "34.9 N s/m"), (0.1057e-6, "m/V", "105.7 nm/V"),
    (2.5e5, "Hz", "250 kHz"), (0.05, "kg", "0.05 kg"), (3303.1, "rad/s", "3303 rad/s"),
    (0.001308, "rad/s", "1.308 mrad/s"), (1e-12, "m^2", "1e-12 m^2"), (0.9979, "", "0.9979"),
    (0.0, "m", "0 m"), (2e-16, "m", "0.0002 pm"), (3e13, "Hz", "3e+04 GHz"),
    (math.inf, "rad/s", "inf rad/s"), (math.nan, "m", "nan m"),
]  # fmt: skip


def test_with_prefix() -> None:
    for value, unit, shown in SHOWN:
        assert with_prefix(value, unit) == shown
    assert with_prefix(25.565959e-6, "m", 7) == "25.56596 µm"
    assert with_prefix(25.565959e-6, "m", 1) == "30 µm"


@given(st.floats(1e-11, 1e11) | st.floats(-1e11, -1e-11), st.integers(3, 9))
def test_with_prefix_reads_back(value: float, digits: int) -> None:
    shown = with_prefix(value, "V", digits)
    assert to_si(shown, "V") == pytest.approx(value, rel=0.5000001 * 10.0 ** (1 - digits))
    assert 1 <= abs(float(shown.split()[0])) < 1000


def test_what_is_not_quite_one_does_not_look_like_it() -> None:
    for text in ("0.9987", "0.999960", "0.9999935", "1.0000", "-5.7000"):
        assert near_one(float(text)) == text
