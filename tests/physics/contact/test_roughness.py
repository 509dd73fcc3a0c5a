"""Roughness of spectra, arrays and instruments' files; a bare Ra is none."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from stickslip.physics.contact import (
    GreenwoodWilliamson,
    Persson,
    Roughness,
    measured,
    of_topography,
    read_topography,
    self_affine,
)
from stickslip.quantities.units import QuantityError

from .half_space import rough

UM = 1e-6


def test_the_limit_of_the_hurst_exponent() -> None:
    """A spectrum is as near to that of H = 1 as its exponent is."""
    ends = {"longest": 1e-4, "shortest": 1e-8, "roll_off": 1e-5}
    limit = self_affine(1e-6, 1.0, **ends).slope
    for lacking in (1e-9, 1e-12, 1e-15):
        assert self_affine(1e-6, 1.0 - lacking, **ends).slope == pytest.approx(
            limit, rel=20.0 * lacking + 1e-13
        )


@pytest.mark.parametrize("hurst", [0.5, 0.8, 1.0])
def test_spectrum(hurst: float) -> None:
    """The moments, by numerical integration of a spectrum with a plateau."""
    found = self_affine("0.4 um", hurst, longest="200 um", shortest="2 um", roll_off="50 um")
    q = [2.0 * math.pi / wavelength for wavelength in (200 * UM, 50 * UM, 2 * UM)]

    def moment(power: int) -> float:
        def of(x: float) -> float:
            return x**power * min(1.0, (q[1] / x) ** (2.0 + 2.0 * hurst))

        return sum(quad(of, a, b, epsabs=0.0)[0] for a, b in pairwise(q))

    assert found.height == 0.4 * UM
    assert found.slope == pytest.approx(0.4 * UM * math.sqrt(moment(3) / moment(1)), rel=1e-6)
    assert found.curvature == pytest.approx(0.4 * UM * math.sqrt(moment(5) / moment(1)), rel=1e-6)


def test_a_map_and_its_lines_tell_what_its_spectrum_is_of() -> None:
    """A random surface of which the spectrum is known; tilt and bow do not count."""
    n, spacing = 512, 1.0 * UM
    z = 0.3 * UM * rough(n, spacing, 0.8, 64 * UM, 16 * UM, seed=3)
    expected = self_affine("0.3 um", 0.8, longest="64 um", shortest="16 um")
    x, y = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n), indexing="ij")
    bowed = z + UM * (5.0 * x - 3.0 * y + 20.0 * x**2 + 4.0 * x * y)
    found = measured(bowed, "1 um")
    for name in ("height", "slope", "curvature"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=0.08), name
    assert (found.longest, found.shortest) == (pytest.approx(511 * UM), pytest.approx(2 * UM))
    lines = [measured(line, "1 um") for line in z[::8]]
    for name in ("slope", "curvature"):
        mean = math.sqrt(np.mean([getattr(line, name) ** 2 for line in lines]))
        assert mean == pytest.approx(getattr(found, name), rel=0.05), name
    stretched = measured(z[:, ::2], ("1 um", "2 um"))
    assert stretched.slope == pytest.approx(found.slope, rel=0.05)


def test_two_surfaces_and_the_models_of_them() -> None:
    one = self_affine("0.3 um", 0.8, longest="100 um", shortest="1 um")
    two = self_affine("0.4 um", 0.8, longest="50 um", shortest="2 um")
    both = one.with_other(two)
    assert both.height == pytest.approx(0.5 * UM)
    assert (both.longest, both.shortest) == (pytest.approx(100 * UM), 1 * UM)
    summits = GreenwoodWilliamson.of_roughness("1 N", "1 mm^2", both, "100 GPa")
    # Of a narrow spectrum, Longuet-Higgins' density of summits is π/(4 √3 ... ) ~ 1 per wavelength squared.
    narrow = self_affine("0.1 um", 0.8, longest="10.01 um", shortest="10 um")
    of = GreenwoodWilliamson.of_roughness("1 mN", "1 mm^2", narrow, "100 GPa")
    assert of.summits * (10 * UM) ** 2 / 1e-6 == pytest.approx(math.pi / math.sqrt(3.0) / 2.0, rel=0.3)
    assert of.summit_deviation == pytest.approx(0.1 * UM * math.sqrt(1.0 - 0.8968 / 1.5), rel=1e-2)
    assert of.summit_radius == pytest.approx(0.375 * math.sqrt(math.pi / 0.375) / narrow.curvature)
    assert summits.stiffness_scatter < 1.0
    assert summits.plasticity_index > 0.0
    found = Persson("1 N", "1 mm^2", both, "100 GPa")
    assert found.real_area == pytest.approx(
        math.sqrt(8.0 / math.pi) / (100e9 * both.slope), rel=1e-3, abs=0.0
    )
    assert found.pressure == 1e6
    assert "single summits" in found._replace(normal_force=1e-3).holds()
    assert "% of the nominal area touch" in found._replace(normal_force=1e4).holds()
    assert found._replace(normal_force=10 * found.least_force).holds() == ""


def test_files_of_instruments(tmp_path: Path) -> None:
    """Through SurfaceTopography: a text with its size and unit; one without, and what is none."""
    z = 1e-7 * np.random.default_rng(0).standard_normal((32, 48))
    head = "Width: 48 um\nHeight: 32 um\nValue units: um"
    np.savetxt(tmp_path / "scan.asc", z * 1e6, header=head)
    found = read_topography(tmp_path / "scan.asc")
    assert found.height == pytest.approx(measured(z, "1 um").height)
    assert found.slope == pytest.approx(measured(z, "1 um").slope, rel=1e-6)
    np.savetxt(tmp_path / "bare.asc", z)
    with pytest.raises(QuantityError, match=r"bare\.asc"):
        read_topography(tmp_path / "bare.asc")
    (tmp_path / "text.txt").write_text("no heights")
    for name in ("text.txt", "missing.opd"):
        with pytest.raises(QuantityError, match=f"{name} cannot be read as a topography"):
            read_topography(tmp_path / name)


class Scan:
    """What SurfaceTopography hands over, as far as it is looked at."""

    unit, has_undefined_data, is_uniform, pixel_size = "nm", False, True, (500.0, 500.0)

    def heights(self) -> np.ndarray:
        return 100.0 * np.random.default_rng(0).standard_normal((20, 20))


@pytest.mark.parametrize("height", [0.0, 1e-6, 0.1, 1.0])
def test_a_plane_far_from_zero_has_no_roughness(height: float) -> None:
    with pytest.raises(QuantityError, match="all alike"):
        measured(np.full(100, height), "0.2 um")
    assert measured(height + 1e-8 * np.random.default_rng(0).standard_normal(500), "0.2 um").height < 2e-8


def test_scans_that_are_none() -> None:
    scan = Scan()
    assert of_topography(scan).height == pytest.approx(1e-7, rel=0.1)
    assert of_topography(scan).shortest == pytest.approx(1e-6)
    for field, value, match in (
        ("unit", None, "no unit of length"),
        ("has_undefined_data", True, "not measured"),
        ("is_uniform", False, "uneven steps"),
    ):
        bad = Scan()
        setattr(bad, field, value)
        with pytest.raises(QuantityError, match=match):
            of_topography(bad)


def test_what_is_no_roughness() -> None:
    for wrong, match in (
        (lambda: measured(0.37e-6, "1 um"), "one number, such as Ra, which has no lateral scale"),
        (lambda: measured(np.zeros(3), "1 um"), r"heights of the shape \(3,\)"),
        (lambda: measured(np.arange(20.0), "1 um"), "no roughness in them"),
        (lambda: measured(np.full(20, np.nan), "1 um"), "finite values"),
        (lambda: measured(np.eye(9), 0.0), "spacing = 0.0 is out of range"),
        (lambda: measured(np.eye(9), (1.0, 1.0, 1.0)), "3 values for heights of 2"),
        (lambda: self_affine(1e-6, 1.2, longest=1e-4, shortest=1e-6), "hurst = 1.2"),
        (lambda: self_affine(1e-6, 0.8, longest=1e-6, shortest=1e-4), "grow in this order"),
        (lambda: Roughness(1e-6, 0.1, 1e5, 1e-6, 1e-5), "must be below longest"),
    ):
        with pytest.raises(QuantityError, match=match):
            wrong()
