"""Limits of parameters that nobody has given: those of the law, zero where it may be zero."""

import math

import numpy as np
import pytest

import stickslip as ss
from stickslip.friction import LuGre
from stickslip.identify.free import parameter
from stickslip.quantities.records import quantities
from stickslip.simulation.varied import free_names, value_of

LAWS = (
    ss.LuGre(1e5, 30.0, 2.0, 0.5, 0.6),
    ss.friction.Elastoplastic(1e5, 30.0, 2.0, 0.5, 0.6, 1e-6),
    ss.friction.MaxwellSlip((1e5, 2e5), (0.1, 0.2), 2.0, 1.2),
    ss.friction.Dahl(1e5, 0.5),
)
NOISE = 2e-3


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_default_limits_are_those_of_the_law(law) -> None:
    fields = quantities(type(law))
    for name in free_names(law):
        if not 0.0 < value_of(law, name) < math.inf:
            continue
        p = parameter(law, name, {})
        if name in fields:
            assert p.least == max(fields[name].minimum or 0.0, fields[name].above or 0.0)
            assert p.most == (math.inf if fields[name].maximum is None else fields[name].maximum)
            assert (p.coordinate(0.0) > -math.inf) == (fields[name].minimum == 0.0)
        assert p.value(p.coordinate(p.start)) == pytest.approx(p.start)


def loops(law, seed: int = 3):
    """Force of a prescribed motion, with white noise."""
    t = np.linspace(0, 8, 4001)
    x = 100e-6 * np.sin(2 * np.pi * 0.5 * t) * (1 + 0.3 * np.sin(2 * np.pi * 0.13 * t))
    force = ss.simulation.friction_response(law, t, x).friction_force.values
    force = force + NOISE * np.random.default_rng(seed).standard_normal(t.size)
    return ss.make_recording(t, {"position": (x, "m"), "friction_force": (force, "N")})


@pytest.mark.parametrize("start", [0.0, 5.0])
def test_viscous_friction_that_is_zero_in_loops(start: float) -> None:
    recording = loops(LuGre(1e5, 0.0, 0.0, 0.5, 0.5))
    fit = ss.identify_loops(
        recording,
        LuGre(2e5, 0.0, start, 0.4, 0.4),
        ["sigma_0", "sigma_2", "coulomb_force"],
        tied={"stiction_force": "coulomb_force"},
    )
    ends = fit.confidence_intervals()
    assert ends["sigma_2"][0] == 0.0
    assert 0.15 < ends["sigma_2"][1] < 0.35  # from a fit with bounds (0, 100): 0.235
    assert not any("sigma_2 is 0 times its start" in said for said in fit.remarks)
    assert ends["sigma_0"][0] < 1e5 < ends["sigma_0"][1]
    assert ends["coulomb_force"][0] < 0.5 < ends["coulomb_force"][1]
    assert not fit.failures


@pytest.mark.parametrize("start", [100.0])
def test_viscous_friction_that_is_zero_in_walks(start: float) -> None:
    actuator = ss.load_actuator("kang2007").replace(stage_reaction=False)
    drive = ss.Sawtooth(65.0, 20.0, periods=6)
    walk = ss.simulate(actuator, drive, sample_rate=4e3, tolerance=1e-10)
    position = walk.end_effector_position.values
    position = position + 5e-9 * np.random.default_rng(2).standard_normal(position.size)
    recording = ss.make_recording(walk.time.values, {"end_effector_position": (position, "m")})
    law = actuator.friction
    begin = law._replace(sigma_0=1.2 * law.sigma_0, sigma_1=30.0, coulomb_force=0.6, stiction_force=0.6)
    fit = ss.identify_friction(
        recording,
        actuator.replace(friction=begin._replace(sigma_2=start)),
        ["sigma_0", "sigma_1", "coulomb_force", "sigma_2"],
        drive=drive,
        tied={"stiction_force": "coulomb_force"},
        channel=(),
        hops=0,
    )
    ends = fit.confidence_intervals()
    assert ends["sigma_2"][0] == 0.0
    assert 0.03 < ends["sigma_2"][1] < 0.3
    for name in ("sigma_0", "sigma_1", "coulomb_force"):
        assert ends[name][0] < getattr(law, name) < ends[name][1]
    assert not fit.failures
