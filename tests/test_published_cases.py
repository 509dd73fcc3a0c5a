"""Published cases: what the pages of the gallery show, beside other solvers and closed laws."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

GALLERY = Path(__file__).resolve().parents[1] / "docs" / "gallery"


def made_by(page: str) -> dict[str, Any]:
    """The names that the code of a page leaves."""
    (code,) = re.findall(r"```python\n(.*?)```", (GALLERY / f"{page}.md").read_text("utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(code, names)
    return names


def test_the_mass_pulled_by_a_spring_is_that_of_another_solver() -> None:
    """SciPy's Radau at 1e-10 takes seconds for what takes `simulate` milliseconds."""
    motion = made_by("pulled-by-a-spring")["motion"]

    def equations(t: float, y: np.ndarray) -> list[float]:
        x, v, z = y
        steady = 1.0 + 0.5 * np.exp(-((v / 1e-3) ** 2))
        rate = v - 1e5 * abs(v) * z / steady
        return [v, 2.0 * (0.1 * t - x) - (1e5 * z + np.sqrt(1e5) * rate + 0.4 * v), rate]

    times = motion.time.values[::100]
    found = solve_ivp(
        equations, (0.0, 30.0), [0.0] * 3, "Radau", times, rtol=1e-10, atol=[1e-12, 1e-12, 1e-16]
    )
    off = np.abs(motion.end_effector_position.values[::100] - found.y[0])
    assert off.max() < 1e-7
    assert motion.attrs["error_estimate"] < 1e-7
    assert found.y[0, -1] == pytest.approx(2.545102, abs=1e-6)


def test_vibration_lowers_friction_as_the_closed_laws_say() -> None:
    made = made_by("friction-under-vibration")
    closed, along = made["closed"], made["along"]
    np.testing.assert_allclose(along["Coulomb"], closed, atol=3e-4)  # the samples of a period
    stiff, soft = (np.abs(along[f"Dahl, {share}"] - closed).max() for share in ("3 %", "30 %"))
    assert stiff == pytest.approx(0.09, abs=0.005)
    assert soft == pytest.approx(0.22, abs=0.005)
    # Slow, the least normal force; fast, the mean; between, the contact without mass.
    np.testing.assert_allclose(made["across"], made["exact"], atol=1.5e-3)
    assert made["across"][0] < 1.2 * (1.0 - made["SWING"])
    np.testing.assert_allclose(made["across"][made["pull"] > 1.0], 1.0, atol=1.5e-3)


def test_a_resonance_near_the_step_rate_makes_the_step_grow() -> None:
    """Published: 1.64 times forward and 1.50 times backward, from 41 um."""
    made = made_by("rolling-drive")
    assert float(made["steps"].sel(frequency=10.0)) == pytest.approx(41e-6, rel=0.02)
    assert 1.50 < made["growth"] < 1.64
    stiff = made["stiff"]
    assert float(stiff.sel(frequency=560.0) / stiff.sel(frequency=10.0)) == pytest.approx(1.0, abs=0.02)


def test_a_second_contact_holds_the_slider_while_the_first_slips() -> None:
    """Published: 22.8 % back with one stator, 0.6 % with two."""
    made = made_by("two-contacts")
    assert made["single"] == pytest.approx(0.228, abs=0.001)
    rates, equal = made["rates"], int(np.flatnonzero(made["ratios"] == 1.0)[0])
    assert np.all(np.argmin(rates, axis=1) == equal)
    np.testing.assert_allclose(rates[:, equal], [0.0, 0.0063, 0.0507], atol=5e-4)
    assert made["pair"] == rates[1, equal]


def spool_in_closed_form(duration: float) -> tuple[list[Any], list[Any]]:
    """Pieces (start, end, x(t), v(t)) of the spool's motion from rest at the lower stop, and its impacts.

    Each impact, turn and end of a rest is the root of a known function.
    """
    m, k, preload, f, stops, e = 3.3612e-4, 1488.58, 8.545, 1.0, (0.0, 1.016e-3), 0.3
    force, mean, swing, omega, omega_0 = 7.374e-5 * 6895.0, 18.0, 4.0, 500.0 * np.pi, np.sqrt(1488.58 / m)

    def push(t: Any, x: float) -> Any:
        return force * (mean + swing * np.sin(omega * t)) - preload - k * x

    def sliding(t0: float, x0: float, v0: float, sign: float) -> Any:
        level = (force * mean - preload - sign * f) / k
        forced = force * swing / (k - m * omega**2)
        a = x0 - level - forced * np.sin(omega * t0)
        b = (v0 - forced * omega * np.cos(omega * t0)) / omega_0

        def at(t: Any) -> Any:
            c, s = np.cos(omega_0 * (t - t0)), np.sin(omega_0 * (t - t0))
            x = level + forced * np.sin(omega * t) + a * c + b * s
            return x, forced * omega * np.cos(omega * t) + omega_0 * (b * c - a * s)

        return at

    def first_root(function: Any, t0: float, end: float) -> float:
        for start in np.arange(t0, end, 5e-4):
            t = np.minimum(start + 2e-6 * np.arange(252), end)
            t[0] = max(t[0], t0 + 1e-12)
            found = np.flatnonzero(np.diff(np.sign(function(t))) != 0)
            if found.size:
                return brentq(function, t[found[0]], t[found[0] + 1], xtol=1e-16, rtol=1e-15)  # type: ignore[return-value]
        return end

    t, x, v, pieces, impacts = 0.0, 0.0, 0.0, [], []
    while t < duration:
        if abs(v) <= 1e-9:  # at rest until the push exceeds the friction, away from a stop
            free = [s for s in (1.0, -1.0) if x != stops[int(s > 0)]]
            leave = min(first_root(lambda u, s=s, x=x: s * push(u, x) - f, t, duration) for s in free)
            if leave > t:
                pieces.append((t, leave, lambda u, x=x: (x + 0.0 * u, 0.0 * u)))
            t, v = leave, 0.0
            if t >= duration:
                break
        sign = np.sign(v or push(t, x))
        at = sliding(t, x, v, sign)
        turn = first_root(lambda u, at=at: at(u)[1], t, duration)
        hit = min(first_root(lambda u, at=at, stop=stop: at(u)[0] - stop, t, turn) for stop in stops)
        end = min(turn, hit)
        pieces.append((t, end, at))
        x, v = (float(value) for value in at(end))
        t = end
        if hit < turn:
            impacts.append((t, v))
            x, v = min(stops, key=lambda stop, x=x: abs(stop - x)), -e * v
        elif turn < duration:
            v = 0.0 if abs(push(t, x)) <= f else np.sign(push(t, x)) * 2e-9
    return pieces, impacts


def test_the_spool_rebounds_and_rests_exactly() -> None:
    motion = made_by("spool-valve")["motion"]
    pieces, impacts = spool_in_closed_form(0.016)
    assert motion.attrs["error_estimate"] < 1e-9
    times, velocities = motion.impact_time.values, motion.impact_velocity.values
    assert times.size == 16
    exact_times, exact_velocities = np.array(impacts).T
    assert np.abs((times - exact_times) * exact_velocities).max() < 1e-9  # m, the tolerance of the position
    np.testing.assert_allclose(velocities, exact_velocities, atol=2e-6)
    np.testing.assert_allclose(velocities[4:8], [2.08828, -2.30043, -0.23149, -0.01078], atol=1e-5)
    position, speed = np.zeros(motion.time.size), np.zeros(motion.time.size)
    for start, end, at in pieces:
        inside = (motion.time.values >= start) & (motion.time.values <= end)
        position[inside], speed[inside] = at(motion.time.values[inside])
    assert np.abs(motion.end_effector_position.values - position).max() < 1e-9
    still = speed == 0.0  # held by friction, not creeping
    apart = np.abs(motion.end_effector_velocity.values[still]) > 0.0
    assert still.sum() > 4000
    assert apart.sum() < 20  # of the ends of the rests
