"""Optimised actuators: against brute force, what a simulation makes of them, and refusals."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

import stickslip as ss
from stickslip import design
from stickslip.design import Scenario
from stickslip.design.space import built, space_of
from stickslip.physics.electronics import OutputStage

KANG = ss.load_actuator("kang2007")
HARD = KANG.replace(friction=KANG.friction._replace(coulomb_force=1.0, stiction_force=1.3))
exact = partial(ss.steady_step, tolerance=1e-11)
SAW = ss.Sawtooth(100.0, 400.0, 0.8)
find = partial(design.optimise_actuator, goal="speed", max_voltage=100.0)


def speed(model, waveform, load=1.0):
    return exact(model, waveform, load=load) * waveform.frequency


def test_it_is_as_good_as_the_best_of_a_grid():
    """Pulled back by 0.1 N, a light contact slides on; a heavy one moves less: the best is between them."""
    loads, frequencies = np.geomspace(0.1, 10.0, 8), np.geomspace(200.0, 800.0, 8)
    rises = np.array([0.7, 0.8, 0.9])
    grid = [axis.ravel() for axis in np.meshgrid(loads, frequencies, rises)]
    columns = dict(zip(("load", "frequency", "rise_fraction"), grid, strict=True))
    speeds = [
        ss.steady_steps(
            KANG, SAW, parameters=columns | {"external_force": np.full(grid[0].size, force)}
        ).net_step
        * grid[1]
        for force in (0.0, -0.1)
    ]
    best = float(np.nanmax(np.min(speeds, axis=0)))
    pulled = Scenario(external_force="-0.1 N")
    found = find(KANG, free={"load": (0.1, 10.0)}, frequency=(200.0, 800.0), scenarios=[pulled])
    assert 0.999 * best < found.value < 1.1 * best
    assert found.value > found.given_value
    at_rest = speed(found.model, found.waveform, found.load)
    assert found.best.values[0] == pytest.approx(at_rest, rel=1e-4)
    assert 0.2 < found.load < 9.0
    assert list(found.table["at"]) == [""]


def test_a_condition_changes_what_is_free_in_proportion():
    """A softer mounting lowers the natural frequency of every candidate, which is that of the stage's mass
    and stiffness."""
    softer = Scenario(factors={"natural_frequency": 0.9})
    pulled = Scenario(external_force="-0.1 N", factors={"stage_mass": 1.2})
    free = {"stage_stiffness": ("0.6 N/um", "1.5 N/um"), "stage_mass": ("60 g", "150 g")}
    found = find(KANG, free=free, scenarios=[softer, pulled], budget=100)
    model, drive, drift = found.model, found.waveform, found.best.found
    assert model.natural_frequency == pytest.approx(math.sqrt(drift[0] / drift[1]))
    assert model.stage_mass == drift[1]
    others = [
        model,
        model.replace(natural_frequency=0.9 * model.natural_frequency),
        model.replace(external_force=-0.1, stage_mass=1.2 * model.stage_mass),
    ]
    expected = [speed(other, drive) for other in others]
    assert found.best.values == pytest.approx(expected, rel=1e-4)
    assert found.value == min(found.best.values)
    assert "in the worst of 3 conditions" in found.report()


def test_the_stiffness_stays_where_only_the_mass_is_free():
    space = space_of(KANG, {"stage_mass": ("50 g", "0.2 kg"), "coulomb_force": (0.2, 0.4)})
    heavy = built(space, np.array([0.2, 0.3]))
    assert heavy.stage_stiffness == pytest.approx(KANG.stage_stiffness)
    assert heavy.friction.stiction_force / 0.3 == pytest.approx(
        KANG.friction.stiction_force / KANG.friction.coulomb_force
    )
    own = space_of(KANG, {"stage_mass": ("50 g", "0.2 kg"), "natural_frequency": (2e3, 5e3)})
    assert built(own, np.array([0.2, 3e3])).natural_frequency == 3e3
    for one in (space, own):
        x = np.array([[0.0, 0.3], [1.0, 0.8]])
        assert [one.shares(row) for row in one.values(x)] == [pytest.approx(row) for row in x]


def test_what_has_to_be_held_is():
    """The fastest contact is a light one; it must hold 1 N."""
    found = find(KANG, free={"load": (0.3, 3.0)}, holding_force="1 N")
    assert found.load * KANG.friction.coulomb_force == pytest.approx(1.0, rel=5e-3)
    with pytest.raises(ss.QuantityError, match="holding_force = 2 N is not reached"):
        find(KANG, free={"load": (0.3, 3.0)}, holding_force="2 N", budget=100)


def test_the_best_of_several():
    models = {"as identified": KANG, "harder": HARD}
    found = find(
        models,
        goal=design.Current("1.8 uF"),
        minimum_speed="1 mm/s",
        free={"end_effector_mass": ("50 g", "0.2 kg")},
        output={"as identified": OutputStage(), "harder": OutputStage(slew_rate=1e6)},
        budget=2000,  # for a search that ends at the bound, and not just before it
    )
    assert list(found.choices.index) == list(models)
    assert found.choices["value"].idxmin() == found.name  # current: less is better
    assert found.choices["value"].min() == found.value
    assert np.all(found.best.speeds >= 0.999e-3)
    assert f"best of 2: {found.name}" in found.report()
    assert "at the high end" in found.report()


LOAD = {"load": (0.5, 2.0)}
REFUSED = [
    ({"free": {}}, "free"),
    ({"free": {"stage_mas": (1, 2)}}, "stage_mass"),
    ({"free": {"stage_mass": "1 kg"}}, "low, high"),
    ({"free": {"stage_mass": ("2 kg", "1 kg")}}, "first"),
    ({"free": {"stage_mass": ("1 N", "2 N")}}, "kg"),
    ({"free": {"stage_stiffness": (1e6, 2e6), "natural_frequency": (1e3, 4e3)}}, "stage_stiffness"),
    ({"free": LOAD, "goal": design.Current(1e-6)}, "minimum_speed"),
    ({"free": LOAD, "output": {"a": OutputStage()}}, "outputs"),
    ({"free": {"external_force": (-0.1, 0.1)}, "scenarios": [{"external_force": 0.1}]}, "leave out one"),
    ({"free": LOAD, "goal": design.Current(1e-6), "minimum_speed": "1 m/s", "budget": 50}, "not reached"),
    ({"free": {"load": (0.5, math.inf)}}, "load"),
]


@pytest.mark.parametrize(("given", "said"), REFUSED)
def test_refused(given, said):
    with pytest.raises(ss.QuantityError, match=said):
        find(KANG, **given)


def test_refused_of_models():
    with pytest.raises(ss.QuantityError, match="no actuator"):
        find({}, free={"load": (0.5, 2.0)})
    with pytest.raises(ss.QuantityError, match="clamped"):
        find(KANG.replace(clamped=True), free={"load": (0.5, 2.0)})
    maxwell = KANG.replace(friction=ss.MaxwellSlip((1e6, 2e6), (0.3, 0.4)))
    with pytest.raises(ss.QuantityError, match="MaxwellSlip has no coulomb_force"):
        find(maxwell, free={"load": (0.5, 2.0)}, holding_force="1 N")
