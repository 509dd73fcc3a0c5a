"""Periodic orbits by the engine: the stored ones of random plants, and that a period leads back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from engine import cases
from engine.stored import stored
from stickslip.engine import binding, members, orbits
from stickslip.engine.outcome import DONE
from stickslip.simulation import periodic
from stickslip.simulation.models import contact_load
from stickslip.simulation.plant.system import values_of
from stickslip.waveform.members import Drives, common

LAWS = {
    "LuGre": cases.LUGRE,
    "Dahl": ss.Dahl(1e6, 0.5),
    "Dahl with a bound": ss.Dahl(1e6, 0.5, 0.6),
    "elastoplastic": ss.Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7),
    "Coulomb": ss.Coulomb(0.5),
    "Maxwell slip": ss.MaxwellSlip((1.3e6, 4e5), (0.3, 0.2), 4.0, 1.2),
    "reset integrator": ss.ResetIntegrator(1e6, 5e-7, 0.3, 100.0),
}
TOLERANCE, MOST_PERIODS = 1e-9, 400
# What rounding changes of step and states, m, or a tenth of their error; and of multipliers, which come from
# neighbours 1e-12 m away.
CLOSE, CLOSE_MULTIPLIER = 1e-13, 2e-3


ANYWHERE = "anywhere"
SEEDS = (66, 123, 170, 250)  # chosen among 400, as those of `cases`; 170 is found after long waiting


def at_home(law: Any, waveform: str, seed: int = 3) -> tuple[Any, Any, float]:
    """An actuator with a random mass, its drive, and the drive's random frequency."""
    random = np.random.default_rng(seed)
    frequency = 50.0 * random.uniform(0.5, 3.0)
    drive = ss.Sawtooth(65.0, frequency, 0.9) if waveform == "sawtooth" else ss.Sine(50.0, frequency)
    mass = cases.KANG.end_effector_mass * random.uniform(0.5, 2.0)
    return cases.KANG.replace(friction=law, end_effector_mass=mass), drive, frequency


def anywhere(seed: int) -> tuple[Any, Any, float]:
    """An orbit away from home: law, drive, damping, mass and force are random."""
    random = np.random.default_rng(seed)
    frequency, volts = 10 ** random.uniform(1.3, 3.3), 10 ** random.uniform(0.7, 2.2)
    others = (ss.Coulomb(0.05), ss.Stribeck(0.3, 0.6, 1e-3), ss.StictionCoulombViscous(0.4, 0.6, 1.0))
    laws = (*LAWS.values(), *others, ss.LuGre(1.4e6, 5.0, 0.0, 0.3, 0.6))
    waveforms = ss.Sawtooth(volts, frequency, 0.9), ss.Sine(volts, frequency), ss.Sawtooth(volts, frequency)
    actuator = cases.KANG.replace(
        friction=laws[random.integers(len(laws))],
        end_effector_mass=cases.KANG.end_effector_mass * 10 ** random.uniform(-0.7, 0.7),
        damping_ratio=10 ** random.uniform(-2.5, 0.0),
        external_force=random.choice([0.0, 0.0, 0.1, -0.2]),
    )
    return actuator, waveforms[random.integers(3)], frequency


class Task:
    """The search for an orbit."""

    def __init__(self, law: Any, waveform: str, seed: int = 3) -> None:
        self._of(*(anywhere(seed) if waveform == ANYWHERE else at_home(law, waveform, seed)))

    def _of(self, actuator: Any, waveform: Any, frequency: float) -> None:
        contact = contact_load(1.0, 3.0 / frequency)
        system = contact.system(actuator)
        self.drive, self.load = waveform.drive(3.0 / frequency), contact.drive
        self.plant, self.column, self.periods = system.plant, system.slider, np.array([1.0 / frequency])
        self.states = contact.rest(system, self.drive.before)[None].copy()
        self.outcomes, self.smooth = np.zeros(1, np.int64), periodic.has_neighbours(self.plant)

    @property
    def drives(self) -> Drives:
        return common(self.drive)

    def by_engine(self, most: int = MOST_PERIODS) -> orbits.Orbits:
        return orbits.find_orbits(
            members.ComposedMembers(self.plant, values_of(self.plant)),
            members.MemberDrives(self.drives, np.zeros(1, np.int64)),
            binding.DriveTable(self.load),
            *(self.outcomes, self.states, self.periods, TOLERANCE, most, self.column, self.smooth),
        )


STORED = stored("orbits")
ALL = [(name, waveform, 3) for name in LAWS for waveform in ("sawtooth", "sine")]
ALL += [("any law", ANYWHERE, seed) for seed in SEEDS]


def title(name: str, waveform: str, seed: int) -> str:
    return f"{name}, {waveform}, {seed}"


def answered(name: str, waveform: str, seed: int) -> dict[str, np.ndarray]:
    """What is stored of an orbit."""
    task = Task(LAWS.get(name), waveform, seed)
    found = task.by_engine()
    multipliers = np.abs(np.linalg.eigvals(found.jacobian[0]))
    np.testing.assert_allclose(multipliers.max(), found.radius[0], rtol=0.02, atol=CLOSE_MULTIPLIER)
    numbers = task.outcomes, found.periods, found.steps, found.errors, found.radius
    return {"found": np.array([float(one[0]) for one in numbers]), "state": task.states[0]}


@pytest.mark.parametrize(("name", "waveform", "seed"), ALL)
def test_as_stored(name: str, waveform: str, seed: int) -> None:
    found, expected = answered(name, waveform, seed), STORED[title(name, waveform, seed)]
    outcome, periods, step, error, radius = expected["found"]
    assert found["found"][:2].tolist() == [outcome, periods]
    assert outcome == DONE
    assert 0.0 < error < TOLERANCE
    apart = max(CLOSE, 0.1 * error)
    np.testing.assert_allclose(found["found"][2], step, rtol=0.0, atol=apart)
    np.testing.assert_allclose(found["found"][3], error, rtol=0.3)
    np.testing.assert_allclose(found["found"][4], radius, rtol=0.0, atol=CLOSE_MULTIPLIER)
    positions = slice(0, 4, 2)
    np.testing.assert_allclose(found["state"][positions], expected["state"][positions], rtol=0.0, atol=apart)


def test_a_period_from_the_orbit_leads_back_to_it() -> None:
    task = Task(LAWS["LuGre"], "sawtooth", seed=11)
    found, q = task.by_engine(), task.states[0].copy()
    binding.integrate(
        *(binding.ComposedPlant(task.plant), binding.DriveTable(task.drive), binding.DriveTable(task.load)),
        *(q, (0.0, float(task.periods[0])), 1e-12, False, 1_000_000, np.zeros(0), np.zeros((0, 0))),
    )
    assert abs(found.steps[0]) > 10.0 * TOLERANCE
    assert q[task.column] == pytest.approx(found.steps[0], abs=TOLERANCE)
    q[task.column] = 0.0
    modes = slice(0, 2 * len(task.plant.modes), 2)
    np.testing.assert_allclose(q[modes], task.states[0, modes], rtol=0.0, atol=TOLERANCE)


def test_says_that_it_was_not_found_and_leaves_out_what_failed_before() -> None:
    task = Task(LAWS["LuGre"], "sawtooth")
    task.by_engine(most=1)
    assert task.outcomes[0] == binding.library().NOT_FOUND
    found = task.by_engine()
    assert np.isnan(found.steps[0])
    assert found.periods[0] == 0


def test_what_does_not_fit_is_named() -> None:
    task = Task(LAWS["Dahl"], "sine")
    task.column = 5
    with pytest.raises(ValueError, match="there is no state 5: the plants have 5"):
        task.by_engine()
    task.periods = np.ones(2)
    with pytest.raises(ValueError, match="periods has 2 numbers; the engine needs 1"):
        task.by_engine()


@pytest.mark.usefixtures("no_compiler")
def test_what_a_law_raises_ends_the_search(failing_lag: list[float]) -> None:
    task, case = Task(LAWS["Dahl"], "sine"), cases.cases()["an amplifier"]
    task.plant, task.states, task.column = case.plant, case.state[None].copy(), 2
    with pytest.raises(RuntimeError, match="no such contact"):
        task.by_engine()
    assert len(failing_lag) == 101
