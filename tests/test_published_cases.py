"""Published cases: what the pages of the gallery show, beside other solvers and closed laws."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

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
    np.testing.assert_allclose(rates[:, equal], [0.0, 0.015, 0.071], atol=1e-3)
    assert rates[0, equal] < 0.006 < rates[1, equal]


def test_the_spool_rebounds_and_rests_exactly() -> None:
    """Moreau's time stepping approaches the motion in proportion to its step; the motion repeats."""
    made = made_by("spool-valve")
    times, velocities = np.array(made["impacts"]).T
    assert times.size == 16
    np.testing.assert_allclose(times[4:] - times[:-4], 0.004, atol=1e-10)
    np.testing.assert_allclose(velocities[:4], [2.08828, -2.30043, -0.23149, -0.01078], atol=1e-5)
    still = [p for p in made["pieces"] if np.all(p[2](np.linspace(p[0], p[1], 9))[1] == 0.0)]
    assert max(end - start for start, end, _ in still) > 5e-4  # held by friction, not creeping
    assert sum(end - start for start, end, _ in still) > 4e-3

    def stepped(step: float) -> float:
        x, v, worst = 0.0, 0.0, 0.0
        pieces = iter(made["pieces"])
        _, end, at = next(pieces)
        for i in range(round(0.008 / step)):
            pushed = v + made["push"]((i + 0.5) * step, x) * step / made["M"]
            held = made["F"] * step / made["M"]
            pushed = 0.0 if abs(pushed) <= held else pushed - np.sign(pushed) * held
            x += pushed * step
            for stop, way in zip(made["STOPS"], (-1.0, 1.0), strict=True):
                if way * (x - stop) > 0.0 and way * pushed > 0.0:
                    x, pushed = stop, -made["E"] * v if way * v > 1e-4 else 0.0
            v = pushed
            while (i + 1) * step > end:
                _, end, at = next(pieces)
            worst = max(worst, abs(x - at((i + 1) * step)[0]))
        return worst

    coarse, fine = stepped(8e-7), stepped(2e-7)
    assert fine < 3e-7
    assert coarse / fine == pytest.approx(4.0, rel=0.15)
