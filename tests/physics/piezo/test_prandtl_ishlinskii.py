"""Hysteresis: against the operators' definition, its properties, and its inverse."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

import reference
import stickslip as ss
from stickslip.physics.piezo import BoucWen, Piezo, PrandtlIshlinskii, operators
from stickslip.quantities.units import QuantityError
from stickslip.simulation.plant.splitting import through
from stickslip.waveform import Ramp

Array = NDArray[np.float64]


def model(random: np.random.Generator, zones: bool = True) -> PrandtlIshlinskii:
    """One with an inverse: what the dead zones take away leaves half of the first weight."""
    plays = int(random.integers(1, 12))
    weights = random.uniform(0.0, 1.0, plays)
    weights[0] += 0.2
    slopes = random.uniform(-1.0, 1.0, 3) * weights[0] / 10.0
    skews = random.uniform(-1.0, 1.0, 3) / 6.0
    return PrandtlIshlinskii(
        (0.0, *np.sort(random.uniform(0.1, 60.0, plays - 1))),
        tuple(weights),
        tuple(np.sort(random.uniform(-20.0, 100.0, 3))) if zones else (),
        tuple(slopes) if zones else (),
        tuple(skews) if zones and random.random() < 0.7 else (),
    )


def wandering(random: np.random.Generator, count: int = 400) -> Array:
    """A drive that turns at random, V."""
    return np.interp(
        np.arange(count), np.sort(random.integers(0, count, 40)), random.uniform(-50.0, 120.0, 40)
    )


@pytest.mark.parametrize("seed", range(8))
def test_output_is_that_of_the_definition(seed: int) -> None:
    random = np.random.default_rng(seed)
    one, drive = model(random), wandering(random)
    rest = float(random.uniform(-40.0, 80.0))
    expected = reference.prandtl_ishlinskii(one, drive, rest)
    np.testing.assert_allclose(one.output(drive, rest), expected, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_inverse_is_an_inverse(seed: int) -> None:
    random = np.random.default_rng(100 + seed)
    one, drive = model(random), wandering(random)
    wanted = one.output(drive, float(drive[0]))
    np.testing.assert_allclose(one.inverse(wanted, float(drive[0])), drive, atol=1e-8)
    anything = np.cumsum(random.normal(0.0, 5.0, 300))  # turns at every other sample
    np.testing.assert_allclose(one.output(one.inverse(anything, 0.0), 0.0), anything, atol=1e-9)


def test_a_play_without_width_is_linear() -> None:
    drive = wandering(np.random.default_rng(1))
    np.testing.assert_allclose(PrandtlIshlinskii((0.0,), (1.0,)).output(drive), drive)


def test_one_play_is_a_parallelogram() -> None:
    """Up to 30 V and back: it stands still for 2 r after each turn, and comes home r below, or above."""
    one = PrandtlIshlinskii((0.0, 4.0), (0.5, 0.5))
    drive = np.array([0.0, 4.0, 30.0, 22.0, 0.0, 8.0, 30.0])
    play = np.array([0.0, 0.0, 26.0, 26.0, 4.0, 4.0, 26.0])
    np.testing.assert_allclose(one.output(drive), 0.5 * drive + 0.5 * play)


def test_skewed_loops_are_wider_where_the_skew_is() -> None:
    """A loop of 10 V with all of the weight on one play: its lag behind the drive is that of 4 V as the plays
    see them, which are 4 V below the dead zone and 2 V above."""
    one = PrandtlIshlinskii((0.0, 4.0), (0.5, 0.5), (50.0,), (0.0,), (1.0,))
    low = one.output([0.0, 20.0, 30.0, 20.0])
    high = one.output([0.0, 70.0, 80.0, 70.0])
    # seen: 20, 30, 20 V; play 16, 26, 24 V.   seen: 90, 110, 90 V; play 86, 106, 94 V.
    assert low[3] - low[1] == pytest.approx(0.5 * 8.0)
    assert high[3] - high[1] == pytest.approx(0.5 * 8.0)
    np.testing.assert_allclose(low, [0.0, 18.0, 28.0, 22.0])
    np.testing.assert_allclose(high, [0.0, 88.0, 108.0, 92.0])


@pytest.mark.parametrize("seed", range(4))
def test_corners_are_where_the_output_bends(seed: int) -> None:
    """On the ways up and down from a rest: between its corners the output is a line, and at each it bends."""
    random = np.random.default_rng(seed)
    one, rest = model(random), float(random.uniform(5.0, 30.0))
    for up in (1.0, -1.0):
        ways = up * (one.corners(rest, up) - rest)
        inside = np.sort(ways[(ways > 1e-6) & (ways < 100.0)])
        assert inside.size
        fine = rest + up * np.union1d(np.linspace(0.0, 100.0, 2001), inside)
        slopes = np.diff(one.output(fine, rest)) / np.diff(fine)
        bends = np.abs(np.diff(slopes)) > 1e-7
        found = up * (fine[1:-1][bends] - rest)
        assert np.all(np.min(np.abs(found[:, None] - inside), axis=1) < 1e-6)


def test_minor_loops_close_and_are_congruent() -> None:
    """A minor loop between the same voltages has the same shape wherever it hangs, without dead zones."""
    one = model(np.random.default_rng(3), zones=False)
    loop = np.array([40.0, 60.0, 40.0])
    rising = one.output(np.concatenate([[0.0, 60.0], loop]))
    falling = one.output(np.concatenate([[0.0, 110.0, 40.0], loop[1:]]))
    assert rising[-1] == pytest.approx(rising[-3], abs=1e-12)
    assert falling[-1] == pytest.approx(falling[-3], abs=1e-12)
    np.testing.assert_allclose(np.diff(rising[-3:]), np.diff(falling[-3:]), atol=1e-12)


def test_larger_extremes_wipe_smaller_ones_out() -> None:
    one = model(np.random.default_rng(4))
    straight = one.output(np.array([0.0, 110.0, 0.0, 110.0]))
    detour = one.output(np.array([0.0, 50.0, 20.0, 70.0, 30.0, 110.0, 80.0, 90.0, 0.0, 110.0]))
    np.testing.assert_allclose(detour[-2:], straight[-2:], atol=1e-12)


def test_what_is_no_hysteresis_is_refused() -> None:
    for wrong, said in (
        (((0.0, 4.0), (1.0,)), "2 thresholds .V. and 1 weights"),
        (((4.0, 0.0), (1.0, 1.0)), "must ascend"),
        (((), ()), "is empty"),
        (((1.0,), (1.0,)), "no inverse"),
        (((0.0,), (1.0,), (10.0,), (-1.0,)), "no inverse"),
        (((0.0,), (1.0,), (10.0,), (0.1,), (0.1, 0.2)), "1 dead_zones .V. and 2 skews"),
        (((0.0,), (1.0,), (10.0, 20.0), (0.0, 0.0), (-0.6, -0.5)), "plays turn back before the voltage"),
        (((0.0,), (1.0,), (10.0,), (-0.6,), (-0.5,)), "no inverse"),
    ):
        with pytest.raises(QuantityError, match=said):
            PrandtlIshlinskii(*wrong)  # type: ignore[arg-type]


# One whose plays, from rest at 0 V, are on their edges but for the rounding of sums with its dead zones.
SKEWED = PrandtlIshlinskii(
    (0.0, 18.727633276692701),
    (0.7655579648563666, 0.7735361999095332),
    (-57.92251863851145, -15.426950845256137),
    (0.24539311601625163, -0.2116279600875023),
    (-0.0445326464668086, -0.07471390181223736),
)


def test_an_inverse_from_rest_with_skews() -> None:
    """Of 200 models at random, and of one of the 1 % whose inverse got stuck at a corner that it was on."""
    random = np.random.default_rng(7)
    models = [SKEWED] + [model(random) for _ in range(200)]
    for one in models:
        drive = random.uniform(-100.0, 100.0, 30)
        np.testing.assert_allclose(one.inverse(one.output(drive)), drive, atol=1e-9)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_a_play_is_on_its_edge_within_rounding(up: float) -> None:
    """Within 1e-13 of the sum of what it sees, its half-width and the dead zone furthest off: 2, 2 and 3 V.
    The slope of a drive just beyond says whether it is taken along."""
    plays = operators.Operators(*map(np.array, ([0.0, 2.0], [1.0, 1.0], [-3.0, 1.0], [0.0, 0.0], [0.0, 0.0])))
    for off, lacks in ((0.0, False), (6.5e-13, False), (8e-13, True), (0.5, True), (-1.0, False)):
        z = np.array([up * (2.0 - off), up * max(-off, 0.0)])
        drive = Ramp(up).drive(1.0)._replace(polynomial=np.array([[up * (2.0 - off), up, 0.0, 0.0]]))
        made = through(plays, drive, 1.0, z, 0.0)
        assert made.polynomial[0, 1] == up * (1.0 if lacks else 2.0)


def test_the_definition_in_python() -> None:
    """One play and one dead zone, as the exported C and the engine have them by translation."""
    for v, r, z in np.random.default_rng(2).uniform(-50.0, 50.0, (200, 3)):
        expected = float(np.clip(z, v - abs(r), v + abs(r)))
        assert operators.play(v, abs(r), z) == expected
        assert operators.beyond(v, r) == (v - r if v > r else 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_what_plays_see_and_back(seed: int) -> None:
    """The bend of the voltage by its definition, at random voltages, and its inverse."""
    random = np.random.default_rng(40 + seed)
    zones, skews = np.sort(random.uniform(-40.0, 60.0, 3)), random.uniform(-0.3, 0.5, 3)
    plays = operators.Operators(np.zeros(1), np.ones(1), zones, np.zeros(3), skews)
    for u in random.uniform(-100.0, 100.0, 50):
        expected = u + np.sum(skews * (np.maximum(u - zones, 0.0) - np.maximum(-zones, 0.0)))
        assert operators.skewed(plays, u) == pytest.approx(expected, rel=1e-13, abs=1e-12)
        assert operators.unskewed(plays, expected) == pytest.approx(u, rel=1e-12, abs=1e-11)


def test_a_walk_with_skews_is_cut_into_few_pieces() -> None:
    model = ss.load_actuator("kang2007").replace(piezo=Piezo(SKEWED), min_voltage=-100.0, max_voltage=100.0)
    drive = ss.Sawtooth(-60.0, 50.0, periods=3)
    moved = ss.simulate(model, drive, times=[0.01, 0.019999], tolerance=1e-9)
    expected = model.gain * SKEWED.output([drive.value(0.019999)])[0]
    assert float(moved["stage_position"][1]) == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize("one", [SKEWED, BoucWen(0.3, 0.05, 0.01)])
def test_voltages_with_units_and_what_is_none(one: PrandtlIshlinskii | BoucWen) -> None:
    volts = [10.0, 40.0, -5.0]
    labelled = xr.DataArray(1e3 * np.array(volts), dims="time", attrs={"units": "mV"})
    for answer in (one.output, one.inverse):
        expected = answer(volts, 2.0)
        np.testing.assert_allclose(answer(labelled, "2 V"), expected)
        np.testing.assert_allclose(answer(["10 V", "0.04 kV", -5], 2), expected)
        for wrong, said in (
            ([1.0, np.nan], r"\[1\] = nan V is not finite"),
            ([[1.0, 2.0]], r"\[V\] of the shape \(1, 2\)"),
            (["3 m"], "expected V"),
        ):
            with pytest.raises(QuantityError, match=said):
                answer(wrong)
        with pytest.raises(QuantityError, match="rest = nan V"):
            answer(volts, np.nan)
    assert one.at_rest(10) == one.at_rest(10.0)
