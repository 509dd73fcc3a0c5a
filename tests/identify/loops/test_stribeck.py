"""Loops whose friction falls with the speed: started anywhere, and passing the fall too fast to see it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stickslip.engine.motion import forces_at
from stickslip.friction import LuGre
from stickslip.identify.loops.fit import identify_loops
from stickslip.recording import make_recording
from stickslip.simulation import friction_response

FREE = ["sigma_0", "sigma_1", "coulomb_force", "stiction_ratio", "stribeck_velocity", "sigma_2"]


def loops(law: LuGre, amplitude: float, samples: int, noise: float, seed: int) -> Any:
    """Loops of two frequencies that begin amid motion, followed at 12 times the rate of the samples."""
    finer, random = 12, np.random.default_rng(seed)
    fine = np.linspace(-1.0, 1.0, 2 * samples * finer + 1)
    a, b = random.uniform(0.0, 2.0 * np.pi, 2)
    x = amplitude * (np.sin(6.0 * np.pi * fine + a) + 0.4 * np.sin(16.2 * np.pi * fine + b))
    z = friction_response(law, fine, x, tolerance=1e-13)["bristle_deflection_1"].values
    force = np.zeros(fine.size)
    forces_at(law, np.gradient(x, fine), z[:, None].copy(), force)
    at = slice(samples * finer, None, finer)
    force = force[at] + noise * random.standard_normal(samples + 1)
    return make_recording(fine[at], {"position": x[at], "friction_force": force})


def truth(law: LuGre) -> dict[str, float]:
    ratio = law.stiction_force / law.coulomb_force
    return {name: getattr(law, name) if name != "stiction_ratio" else ratio for name in FREE}


@pytest.mark.parametrize("start", [1e-2])
def test_the_stribeck_velocity_is_found_from_any_start(start: float) -> None:
    law = LuGre(1e6, 200.0, 50.0, 1.0, 1.3, 5e-5)
    made = loops(law, 1e-5, 1000, 2e-3, 0)
    begin = LuGre(7e5, 300.0, 80.0, 1.1, 1.2, start)
    fit = identify_loops(made, begin, FREE, bounds={"stribeck_velocity": (1e-7, 1e-1)})
    assert fit.values["stribeck_velocity"] == pytest.approx(5e-5, rel=0.1)
    assert fit.values["stiction_ratio"] == pytest.approx(1.3, rel=0.03)
    assert fit.failures == ()


def test_a_fall_that_is_passed_quickly_is_not_determined_and_the_intervals_say_so() -> None:
    """Any greater ratio fits; linearised at the lowest, it was 2.1 at most."""
    law = LuGre(1e6, 71.1, 50.0, 1.0, 1.282, 5e-6)
    made = loops(law, 1e-5, 600, 4e-3, 0)
    fit = identify_loops(made, law._replace(stiction_force=1.1, stribeck_velocity=1e-5), FREE)
    ends = fit.confidence_intervals()
    for name in ("stiction_ratio", "stribeck_velocity"):
        assert ends[name][0] <= truth(law)[name] <= ends[name][1], name
    assert any("stribeck_velocity is not determined" in said for said in fit.undetermined)
    assert ends["stiction_ratio"][1] == math.inf


@pytest.mark.parametrize("deviation", [1e-7])
def test_what_is_known_of_the_stribeck_velocity_limits_it_where_the_ratio_is_at_its_bound(
    deviation: float,
) -> None:
    law = LuGre(1e6, 71.1, 50.0, 1.0, 1.282, 5e-6)
    made = loops(law, 1e-5, 600, 4e-3, 0)
    begin = law._replace(stiction_force=1.1, stribeck_velocity=1e-6)
    known = {"stribeck_velocity": (1e-6, deviation)}
    fit = identify_loops(made, begin, FREE, noise=4e-3, priors=known)
    _, high = fit.confidence_intervals()["stribeck_velocity"]
    assert (high < 2e-6) is (deviation < 1e-6)
