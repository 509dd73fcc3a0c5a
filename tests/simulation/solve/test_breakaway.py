"""Slips of contacts whose friction falls ever more steeply towards rest (exponents of the Stribeck curve
below 1), against an event-driven solver of SciPy."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip.friction import Stribeck
from stickslip.physics.actuator import Actuator, PulledSlider, load_actuator
from stickslip.simulation import simulate, simulate_ensemble, steady_step
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.shapes import Ramp

Array = NDArray[np.float64]
KANG = load_actuator("kang2007")


def actuator(exponent: float) -> Actuator:
    return KANG.replace(friction=Stribeck(0.5401, 0.75, 2e-3, 0.0, exponent))


class Piece(NamedTuple):
    """The drive from `begin` on: value and slope."""

    begin: float
    value: float
    slope: float


def reference(a: Actuator, drive: list[Piece], times: Array) -> Array:
    """Position of the slider: the contact is held until it asks for more than stiction, and slides until it
    is at rest."""
    law, m = a.friction, a.end_effector_mass
    stiffness, damping = a.natural_frequency**2, 2.0 * a.damping_ratio * a.natural_frequency
    both = 1.0 / m + 1.0 / a.stage_mass
    found, q = np.full(times.size, np.nan), np.zeros(4)
    for piece, end in zip(drive, [*(p.begin for p in drive[1:]), times[-1]], strict=True):

        def free(t: float, q: Array, piece: Piece = piece) -> float:
            volts = piece.value + piece.slope * (t - piece.begin)
            return stiffness * (a.gain * volts - q[0]) - damping * q[1]

        def motion(t: float, q: Array, way: float, piece: Piece = piece, free=free) -> list[float]:
            v = way * (q[1] - q[3])
            curve = math.exp(-((max(v, 0.0) / law.stribeck_velocity) ** law.exponent))
            force = way * (law.coulomb_force + (law.stiction_force - law.coulomb_force) * curve)
            force = free(t, q) / both if way == 0.0 else force
            return [q[1], free(t, q) - force / a.stage_mass, q[3], force / m]

        def ends(t: float, q: Array, way: float, free=free) -> float:
            if way == 0.0:
                return law.stiction_force - abs(free(t, q)) / both
            return way * (q[1] - q[3])

        ends.terminal, ends.direction = True, -1
        t = piece.begin
        slides = abs(q[1] - q[3]) > 1e-12
        way = math.copysign(1.0, q[1] - q[3]) if slides else 0.0
        if not slides and ends(t, q, 0.0) < 0.0:
            way = math.copysign(1.0, free(t, q))
        while t < end:
            run = solve_ivp(
                motion, (t, end), q, "DOP853", args=(way,), events=ends, dense_output=True,
                rtol=1e-11, atol=[1e-16, 1e-14, 1e-16, 1e-14], max_step=(end - piece.begin) / 50,
            )  # fmt: skip
            inside = (times >= t) & (times <= run.t[-1])
            if inside.any():
                found[inside] = run.sol(times[inside])[2]
            t, q = run.t[-1], run.y[:, -1].copy()
            if run.status == 1:
                q[3] = q[1]
                loose = way == 0.0 or ends(t, q, 0.0) < 0.0
                way = math.copysign(1.0, free(t, q)) if loose else 0.0
                q[3] -= way * 1e-18
    return found


def random_walk(seed: int) -> tuple[Actuator, object, list[Piece], Array]:
    """Of an actuator whose contact lets go: a saw that jumps, or falls steeply."""
    rng = np.random.default_rng(seed)

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    coulomb, frequency, volts = log(0.05, 0.5), log(20.0, 300.0), log(30.0, 100.0)
    law = Stribeck(
        coulomb,
        coulomb * rng.uniform(1.2, 2.0),
        log(5e-4, 5e-3),
        0.0,
        float(rng.choice([0.15, 0.3, 0.45, 0.5])),
    )
    a = Actuator(1e-7, log(3e3, 1e4), log(0.1, 0.6), log(0.05, 0.2), log(0.05, 0.2), law)
    period, drive = 1.0 / frequency, []
    if seed % 2:
        drive = [Piece(k * period, 0.0, volts * frequency) for k in range(2)]
        return a, Sawtooth(volts, frequency), drive, np.linspace(0.0, 2.0 * period, 160)[1:-1]
    for k in range(2):
        drive += [
            Piece(k * period, 0.0, 10.0 * volts * frequency),
            Piece((k + 0.1) * period, volts, -volts * frequency / 0.9),
        ]
    saw = ReverseSawtooth(volts, frequency, fall_fraction=0.9)
    return a, saw, drive, np.linspace(0.0, 2.0 * period, 160)[1:-1]


def test_slips_agree_with_scipy_and_its_events() -> None:
    """Within two tolerances, and nine of ten within three times the estimate."""
    honest = []
    for seed in range(4):
        a, drive, pieces, times = random_walk(seed)
        expected = reference(a, pieces, times)
        assert np.ptp(expected) > 1e-7
        for tolerance in (1e-9, 1e-10, 1e-12):
            found = simulate(a, drive, times=times, tolerance=tolerance)
            off = np.abs(found["end_effector_position"].values - expected).max()
            assert off < 2.0 * tolerance
            honest.append(off < 3.0 * found.attrs["error_estimate"])
            # Held, it never carries more than its stiction.
            assert np.abs(found["friction_force"]).max() <= a.friction.stiction_force * (1.0 + 1e-8)
    assert np.mean(honest) > 0.9


@pytest.mark.parametrize("exponent", [0.1, 0.5, 0.8])
def test_all_calls_see_the_slips_of_any_exponent(exponent: float) -> None:
    """Where each second slip of an exponent of a half was missed: 6.7 µm instead of 15.6."""
    a, saw = actuator(exponent), Sawtooth(65.0, 50.0)
    times = np.linspace(0.0, 0.06, 172)[1:-1]
    expected = reference(a, [Piece(0.02 * k, 0.0, 3250.0) for k in range(3)], times)
    found = simulate(a, saw, times=times)
    np.testing.assert_allclose(found["end_effector_position"], expected, rtol=0.0, atol=1e-9)
    assert np.abs(found["friction_force"]).max() <= 0.75 * (1.0 + 1e-8)
    members = simulate_ensemble(a, saw, duration=0.06, parameters={"coulomb_force": [0.5401, 0.4]})
    end = simulate(a, saw, times=[0.0, 0.06], tolerance=1e-10)["end_effector_position"].values[-1]
    assert members["net_displacement"].values[0] == pytest.approx(end, abs=1e-9)
    later = simulate(a, saw, times=[0.38, 0.4])["end_effector_position"].values
    assert steady_step(a, saw) == pytest.approx(later[1] - later[0], abs=2e-9)


@pytest.mark.parametrize("exponent", [0.3])
def test_speed_grows_as_a_power_of_time(exponent: float) -> None:
    r"""Of a slow pull, :math:`\dot v = k v^\delta`, k = (F_S - F_C)/(m v_s^δ), from the instant of breakaway:
    v = ((1 - δ) k t)^(1/(1 - δ)), where v << v_s."""
    mass, spring, speed = 0.1, 2000.0, 1e-7
    law = Stribeck(0.5, 0.8, 100.0, 0.0, exponent)
    slider = PulledSlider(mass=mass, spring_stiffness=spring, damping=0.0, friction=law)
    since = np.array([3e-5, 1e-4, 3e-4])
    times = np.append(0.0, 0.8 / (spring * speed) + since)
    found = simulate(slider, Ramp(speed, unit="m"), times=times, tolerance=1e-11)
    growth = 0.3 / (mass * law.stribeck_velocity**exponent)
    expected = ((1.0 - exponent) * growth * since) ** (1.0 / (1.0 - exponent))
    off = 0.5 * (expected / law.stribeck_velocity) ** exponent  # of the law's own power
    assert np.all(off < 0.07)
    ratio = found["end_effector_velocity"].values[1:] / expected
    np.testing.assert_allclose(ratio, 1.0, rtol=0.0, atol=1.2 * off.max() + 2e-3)
