"""Every law in the actuator against an independent integration of the same equations (see `event_driven`)."""

from __future__ import annotations

import numpy as np
import pytest

import event_driven
from friction import samples
from stickslip.friction import LAWS, Dahl
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.shapes import Constant

# Where a law has a set-valued corner with no flag for it (stiction of the reset integrator at each reversal,
# stiction of the Maxwell elements while sliding slows down) SciPy has no smooth pieces to follow, and a Dahl
# exponent below 1 takes it half a minute.
EXAMPLES = [
    law
    for law in samples.ALL
    if getattr(law, "stiction_excess", 0.0) == 0.0
    and getattr(law, "stiction_ratio", 1.0) == 1.0
    and not (type(law).__name__ == "Dahl" and law.exponent < 1.0)
]
every_example = pytest.mark.parametrize("law", EXAMPLES, ids=samples.name)

DRIVE = Sawtooth(amplitude=65.0, frequency=20.0)
PIECES = event_driven.sawtooth(65.0, 20.0, 2)
TIMES = np.linspace(0.0, 0.1, 1601)  # two periods, the second after a flyback


def actuator(law: object, **changes: object) -> Actuator:
    return load_actuator("kang2007").replace(friction=law, **changes)


def test_the_examples_hold_every_law() -> None:
    assert {type(law) for law in EXAMPLES} == set(LAWS)


@every_example
def test_two_periods_of_the_actuator_agree_with_scipy(law: object) -> None:
    model = actuator(law)
    expected = event_driven.trajectory(model, PIECES, TIMES)
    for tolerance in (1e-9, 1e-11):
        found = simulate(model, DRIVE, times=TIMES, tolerance=tolerance)
        for row, name in enumerate(("stage_position", "stage_velocity", "end_effector_position")):
            limit = tolerance * (model.natural_frequency if name == "stage_velocity" else 1.0)
            assert np.max(np.abs(found[name].values - expected[row])) < limit, (name, tolerance)


@pytest.mark.parametrize(
    "changes",
    [
        {"stage_reaction": False},
        {"incline": 0.3},
        {"external_force": 0.2, "stage_reaction": False},
        {"incline": -0.2, "external_force": -0.1, "end_effector_mass": 0.03},
    ],
    ids=lambda changes: ",".join(changes),
)
@pytest.mark.parametrize("law", EXAMPLES[::3], ids=samples.name)
def test_reaction_incline_and_external_force_agree_with_scipy(
    law: object, changes: dict[str, object]
) -> None:
    model = actuator(law, **changes)
    expected = event_driven.trajectory(model, PIECES, TIMES)
    found = simulate(model, DRIVE, times=TIMES, tolerance=1e-10)
    for row, name in ((0, "stage_position"), (2, "end_effector_position")):
        assert np.ptp(expected[row]) > 5e-6
        assert np.max(np.abs(found[name].values - expected[row])) < 5e-10


@every_example
def test_the_output_grid_does_not_change_the_trajectory(law: object) -> None:
    model, tolerance = actuator(law), 1e-10
    coarse = simulate(model, DRIVE, 0.1, sample_rate=1e3, tolerance=tolerance)
    fine = simulate(model, DRIVE, 0.1, sample_rate=7919.0, tolerance=tolerance)
    both = simulate(model, DRIVE, times=np.union1d(coarse["time"], fine["time"]), tolerance=tolerance)
    for one in (coarse, fine):
        same = both.sel(time=one["time"].values)
        for name in ("end_effector_position", "stage_position"):
            assert np.max(np.abs(one[name].values - same[name].values)) < tolerance


@pytest.mark.parametrize("law", [samples.ALL[9], samples.ALL[6]], ids=samples.name)
def test_laws_beyond_scipy_converge_with_the_tolerance(law: object) -> None:
    """The reset integrator with stiction and Dahl's law with an exponent below 1."""
    finest = simulate(actuator(law), DRIVE, times=TIMES, tolerance=1e-11)["end_effector_position"].values
    for tolerance in (1e-8, 1e-9, 1e-10):
        found = simulate(actuator(law), DRIVE, times=TIMES, tolerance=tolerance)
        assert np.max(np.abs(found["end_effector_position"].values - finest)) < 2 * tolerance


@pytest.mark.parametrize("exponent", [0.9, 0.5, 0.2, 0.01])
@pytest.mark.parametrize("force", [0.54, 0.5406, 1.3, 100.0])
def test_a_brittle_contact_slides_on_its_bound_in_few_steps(exponent: float, force: float) -> None:
    """Pulled beyond F_C it slides by a half a t^2 from the start, where its force cannot rise any more."""
    model = actuator(Dahl(1.399e6, 0.5401, exponent), external_force=force)
    found = simulate(model, Constant(0.0), 0.3, max_steps=2000)
    expected = 0.5 * max(force - 0.5401, 0.0) / model.end_effector_mass * 0.3**2
    assert np.ptp(found["end_effector_position"].values) == pytest.approx(expected, abs=2e-9)
    assert found.attrs["outcome"] == "complete"


@pytest.mark.parametrize("exponent", [0.5, 0.2, 0.05])
def test_a_brittle_contact_walks_in_few_steps_at_any_tolerance(exponent: float) -> None:
    walks = {
        tolerance: simulate(
            actuator(Dahl(1.399e6, 0.54, exponent)), DRIVE, times=TIMES, tolerance=tolerance, max_steps=2000
        )
        for tolerance in (1e-8, 1e-9, 1e-10, 1e-11)
    }
    finest = walks.pop(1e-11)["end_effector_position"].values
    for tolerance, found in walks.items():
        assert np.max(np.abs(found["end_effector_position"].values - finest)) < tolerance
