"""What the thesis says of its figures holds for ours, and they show the numbers that they are given."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from stickslip.friction import Coulomb, CoulombViscous, Elastoplastic, StictionCoulombViscous, Stribeck
from stickslip.physics.actuator import load_actuator
from stickslip.report.figures import thesis
from stickslip.simulation import simulate
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth

STATIC = {
    "a": Coulomb(0.54),
    "b": CoulombViscous(0.54, 20.0),
    "c": StictionCoulombViscous(0.54, 0.7, 20.0),
    "d": Stribeck(0.54, 0.7, 2e-3, 20.0),
}


def lines(figure: Figure, panel: int) -> list[tuple[np.ndarray, np.ndarray]]:
    return [tuple(np.asarray(one.get_data(), dtype=float)) for one in figure.axes[panel].lines]


# ---- Fig. 2.1 and 2.4


def test_static_laws_show_the_curve_and_the_set_of_forces_at_rest() -> None:
    figure = thesis.static_laws(STATIC, speed=8e-3)
    assert figure.axes[2].get_xlabel() == "sliding velocity (mm/s)"
    assert figure.axes[0].get_ylabel() == "friction force (mN)"
    for panel, (name, law) in enumerate(STATIC.items()):
        found = lines(figure, panel)
        upright = next(f for v, f in found if v.size == 2 and np.all(v == 0.0))
        most = 1e3 * getattr(law, "stiction_force", 0.54)
        np.testing.assert_allclose(upright, [-most, most])
        right = next((v, f) for v, f in found if v.size > 10 and v[-1] > 0)
        left = next((v, f) for v, f in found if v.size > 10 and v[-1] < 0)
        np.testing.assert_allclose(left[0], -right[0])
        np.testing.assert_allclose(left[1], -right[1])
        g = 540.0 + (160.0 * np.exp(-((right[0] / 2.0) ** 2)) if name == "d" else 0.0)
        viscous = 0.0 if name == "a" else 20.0
        np.testing.assert_allclose(right[1], g + viscous * right[0], rtol=1e-9)
        open_ends = sum(v.size == 1 for v, _ in found)
        assert open_ends == (2 if name == "c" else 0)  # only there the force falls at once


def test_plastic_share_is_mirrored_and_none_against_the_motion() -> None:
    law = Elastoplastic(1.399e6, 0.0, 0.0, 0.5401, 0.5401, 0.5 * 0.5401 / 1.399e6)
    forward, backward = lines(thesis.plastic_share_over_deflection(law), 0)[:2]
    z_ss = 1e9 * 0.5401 / 1.399e6  # the axis is in nm
    z, share = forward
    assert np.all(share[z <= 0.5 * z_ss * (1 + 1e-9)] == 0.0)
    assert np.all(share[z >= z_ss * (1 + 1e-9)] == 1.0)
    assert share[np.argmin(np.abs(z - 0.75 * z_ss))] == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(backward[1], share[::-1], atol=1e-12)
    np.testing.assert_allclose(backward[0], z)


# ---- Fig. 3.1 to 3.4

DEMONSTRATION = thesis.demonstration()
SIGMA = {"3.1": (1e8, 0.0), "3.2": (0.0, 2.5e7), "3.3": (0.0, 0.0), "3.4": (1e8, 2.5e7)}


def response(name: str) -> tuple[np.ndarray, np.ndarray]:
    one = DEMONSTRATION[name]
    return one["position"].values, one["friction_force"].values


@pytest.mark.parametrize("name", SIGMA)
def test_lugre_under_the_parabola_agrees_with_scipy_and_the_closed_form(name: str) -> None:
    (sigma_1, sigma_2), (x, force) = SIGMA[name], response(name)
    time = DEMONSTRATION[name]["time"].values
    np.testing.assert_allclose(x, 15e-6 * time**2, rtol=1e-12)

    def bristle(t: float, z: np.ndarray) -> np.ndarray:
        return 30e-6 * t * (1 - 6e8 * z / 10.0)

    z = solve_ivp(bristle, (0.0, time[-1]), [0.0], "LSODA", time, rtol=1e-10, atol=1e-18).y[0]
    sticking = 1 - 6e8 * z / 10.0
    np.testing.assert_allclose(sticking, np.exp(-6e8 * x / 10.0), atol=1e-7)
    v = 30e-6 * (time - 0.5 * time[1])  # samples are joined by lines: the speed of the interval before
    expected = 10.0 * (1 - sticking) + sigma_1 * v * sticking + sigma_2 * v
    np.testing.assert_allclose(force[1:], expected[1:], atol=1e-4)


def test_parabola_panels_show_the_forces() -> None:
    figure = thesis.under_the_parabola(DEMONSTRATION)
    for panel, name in enumerate(SIGMA):
        assert figure.axes[panel].get_title("left").startswith(name)
        grid, shown = lines(figure, panel)
        np.testing.assert_allclose(grid[1], 10.0)
        np.testing.assert_allclose(shown[0], 1e9 * response(name)[0])
        np.testing.assert_array_equal(shown[1], response(name)[1])


# ---- Drive and walk


def test_drive_jumps_upright() -> None:
    figure = thesis.drive_signals({"there": Sawtooth(65.0, 5.0), "back": ReverseSawtooth(65.0, 5.0)}, 0.6)
    (time, volts), (_, back) = lines(figure, 0)[0], lines(figure, 1)[0]
    clock = 1.0 if "(s)" in figure.axes[1].get_xlabel() else 1e-3
    np.testing.assert_allclose(clock * time, [0, 0.2, 0.2, 0.4, 0.4, 0.6], atol=1e-9)
    np.testing.assert_allclose(volts, [0, 65, 0, 65, 0, 65], atol=1e-6)
    np.testing.assert_allclose(back, [65, 0, 65, 0, 65, 0], atol=1e-6)


def test_walk_shows_the_recording_and_one_flyback() -> None:
    times = np.unique(np.append(np.linspace(0, 0.3, 151), 0.2 + np.linspace(0, 0.01, 101)).round(9))
    d = simulate(load_actuator("kang2007"), Sawtooth(65.0, 5.0), times=times)
    figure = thesis.walk(d, (0.2, 0.21), friction=0.5401)
    assert len(figure.axes) == 8
    stage, slider = lines(figure, 2)
    np.testing.assert_allclose(stage[1], 1e6 * d["stage_position"].values)
    np.testing.assert_allclose(slider[1], 1e6 * d["end_effector_position"].values)
    *levels, force = lines(figure, 7)
    assert sorted(level[1][0] for level in levels) == pytest.approx([-540.1, 540.1])
    assert force[0][0] == pytest.approx(0.0)
    assert force[0][-1] == pytest.approx(10.0)  # ms
    assert np.abs(force[1]).max() == pytest.approx(540.1, rel=0.01)
    back = thesis.there_and_back(d)
    np.testing.assert_allclose(lines(back, 1)[0][1], 1e6 * d["end_effector_position"].values)


def test_loops_have_one_panel_each() -> None:
    x = np.linspace(0, 1e-6, 50)
    figure = thesis.friction_loops({name: (x, k * x) for k, name in enumerate("abcd", start=100_000)})
    assert len(figure.axes) == 4
    for k, panel in enumerate(range(4), start=100_000):
        (way, force), *_ = lines(figure, panel)
        np.testing.assert_allclose(way, 1e6 * x)
        np.testing.assert_allclose(force, 1e3 * k * x)
