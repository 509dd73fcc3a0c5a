"""Two actuators under one end-effector, against SciPy and against one actuator of twice the strength."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import stickslip as ss
from stickslip.simulation import simulate_together

LAW = ss.LuGre(1.4e6, 35.0, 0.0, coulomb_force=0.54, stiction_force=0.6, stribeck_velocity=1e-3)
ACTUATOR = ss.load_actuator("kang2007").replace(friction=LAW, stage_reaction=True)
EARLY, LATE = ss.Sawtooth(65.0, 20.0), ss.PeriodicKnots((0.01, 0.0101), (65.0, 0.0), 0.05)


def test_two_alike_are_one_of_twice_the_strength() -> None:
    both = simulate_together([ACTUATOR, ACTUATOR], [EARLY, EARLY], 0.12, sample_rate=5e3)
    twice = LAW._replace(sigma_0=2.8e6, sigma_1=70.0, coulomb_force=1.08, stiction_force=1.2)
    one = ss.simulate(
        ACTUATOR.replace(friction=twice, stage_mass=2.0 * ACTUATOR.stage_mass), EARLY, 0.12, sample_rate=5e3
    )
    for name in ("end_effector_position", "end_effector_velocity"):
        np.testing.assert_allclose(both[name], one[name], atol=2e-9 * (3e3 if "velocity" in name else 1.0))
    np.testing.assert_allclose(
        both["friction_force"].sum("actuator"), one["friction_force"], atol=3e-3
    )  # 1 nm at 2.8 MN/m
    np.testing.assert_allclose(both["stage_position"].values, [one["stage_position"].values] * 2, atol=2e-9)
    assert both.attrs["error_estimate"] < 1e-9


def test_stages_with_drives_of_their_own_move_as_the_equations_say() -> None:
    times = np.linspace(0.0, 0.02, 101)
    other = ACTUATOR.replace(gain=-0.5 * ACTUATOR.gain, friction=LAW._replace(coulomb_force=0.4))
    found = simulate_together([ACTUATOR, other], [EARLY, LATE], times=times)

    def equations(t: float, q: Any) -> list[float]:
        falls = 65.0 * (0.0101 - t) / 1e-4
        volts = 1300.0 * t, falls if 0.01 <= t < 0.0101 else 65.0 * ((t - 0.0101) % 0.05) / 0.0499
        x_dot, made, total = q[1], [], 0.0
        for i, (a, u) in enumerate(zip((ACTUATOR, other), volts, strict=True)):
            y, w, z = q[2 + 3 * i : 5 + 3 * i]
            law, v = a.friction, w - x_dot
            g = law.coulomb_force + (law.stiction_force - law.coulomb_force) * np.exp(
                -((v / law.stribeck_velocity) ** 2)
            )
            rate = v - law.sigma_0 * abs(v) * z / g
            force = law.sigma_0 * z + law.sigma_1 * rate
            omega, zeta = a.natural_frequency, a.damping_ratio
            made += [w, omega**2 * (a.gain * u - y) - 2 * zeta * omega * w - force / a.stage_mass, rate]
            total += force
        return [x_dot, total / ACTUATOR.end_effector_mass, *made]

    q, at, rows = np.zeros(8), 0.0, []
    q[5] = other.gain * LATE.value([0.0])[0]
    for stop in (0.01, 0.0101, 0.02):  # between the breaks of both drives
        inside = times[(times >= at) & ((times < stop) if stop < 0.02 else (times <= stop))]
        end = stop - 1e-12
        part = solve_ivp(equations, (at, end), q, "Radau", dense_output=True, rtol=1e-8, atol=1e-12)
        rows += part.sol(inside)[0].tolist() if inside.size else []
        q, at = part.y[:, -1], stop
    np.testing.assert_allclose(found["end_effector_position"], rows, atol=3e-9)


def test_what_cannot_be_joined_is_refused() -> None:
    heavy = ACTUATOR.replace(end_effector_mass=1.0)
    static = ACTUATOR.replace(friction=ss.Coulomb(0.5))
    for actuators, waveforms, said in (
        ([ACTUATOR], [EARLY], "at least two"),
        ([ACTUATOR, heavy], [EARLY, LATE], r"actuators\[1\].end_effector_mass = 1"),
        ([ACTUATOR, static], [EARLY, LATE], "two contacts of Coulomb"),
        ([ACTUATOR, ACTUATOR.replace(clamped=True)], [EARLY, LATE], r"actuators\[1\]: a clamped"),
        ([ACTUATOR, ACTUATOR], [EARLY], "2 actuators need as many waveforms, not 1"),
        (
            [ACTUATOR, ACTUATOR],
            [EARLY, ss.Sine(10.0, 20.0, offset=20.0)],
            r"waveforms\[1\]: a Sine is not straight",
        ),
    ):
        with pytest.raises(ss.QuantityError, match=said):
            simulate_together(actuators, waveforms, 0.1)


def test_the_backward_rate_is_of_the_way_forward_wherever_the_period_begins() -> None:
    walk = np.array([0.0, 4.0, 3.0, 4.0]) * 1e-6  # 1 um back on 5 um forward, net 4 um
    assert ss.design.backward_rate(walk) == pytest.approx(0.2)
    assert ss.design.backward_rate(-walk) == pytest.approx(0.2)
    late = np.array([0.0, -1.0, 0.0, 4.0]) * 1e-6  # from the top on
    assert ss.design.backward_rate(late) == pytest.approx(0.2)
    assert ss.design.backward_rate(np.array([0.0, 1.0, 0.0])) == 1.0
    with pytest.raises(ss.QuantityError, match="at least two positions"):
        ss.design.backward_rate([0.0])
