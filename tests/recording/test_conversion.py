"""Unit strings of files against conversions by hand."""

from __future__ import annotations

import math

import pytest

from stickslip.quantities.units import QuantityError
from stickslip.recording.conversion import SI_UNITS, is_unit, to_si_unit

FACTORS = (
    # A newton metre is to most parsers a nautical mile, and a joule of the dimension of a torque.
    ("mm", "m", 1e-3), ("um", "m", 1e-6), ("µm", "m", 1e-6), ("uN", "N", 1e-6), ("mV", "V", 1e-3),
    ("ms", "s", 1e-3), ("kHz", "Hz", 1e3), ("mm/s", "m/s", 1e-3), ("N/um", "N/m", 1e6), ("Nm", "N m", 1.0),
    ("mJ", "J", 1e-3), ("rpm", "rad/s", 2 * math.pi / 60), ("deg", "rad", math.pi / 180),
    ("mdeg", "rad", math.pi / 180e3), ("arcsec", "rad", math.pi / 648e3), ("turn", "rad", 2 * math.pi),
    ("°", "rad", math.pi / 180), ("mrad", "rad", 1e-3), ("%", "", 1e-2), ("-", "", 1.0), ("", "", 1.0),
    ("1", "", 1.0), ("Volts", "V", 1.0), ("Newton", "N", 1.0), ("mN", "N", 1e-3), ("MN", "N", 1e6),
)  # fmt: skip


def test_factors() -> None:
    for written, unit, factor in FACTORS:
        assert to_si_unit(written) == (unit, pytest.approx(factor, rel=1e-14), 0.0), written
    for unit in SI_UNITS:
        assert to_si_unit(unit) == (unit, 1.0, 0.0)


def test_celsius_has_another_zero() -> None:
    conversion = to_si_unit("degC")
    assert (conversion.unit, conversion.offset) == ("K", 273.15)
    assert conversion.factor * 20.0 + conversion.offset == pytest.approx(293.15, rel=1e-14)


def test_unknown() -> None:
    for written in ("stories", "raw", "a.u.", "mm)", "m^9^9^9"):
        assert not is_unit(written)
        with pytest.raises(QuantityError, match="not known"):
            to_si_unit(written)
