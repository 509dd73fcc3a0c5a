"""Laws ranked by walks: viscous friction where there is some, none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.friction import CoulombViscous, MaxwellSlip
from stickslip.identify.walk.compare import CHANG_LI, POHL, compare_walks, walk_candidates
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import load_actuator
from stickslip.simulation import simulate
from stickslip.simulation.varied import with_values
from stickslip.waveform.periodic import Sawtooth


def test_the_law_that_made_the_walk_wins() -> None:
    model = load_actuator("kang2007").replace(stage_reaction=False, friction=CoulombViscous(0.5, 8.0))
    walks = []
    for volts in (65.0, 75.0):
        walk = simulate(model, Sawtooth(volts, 100.0, periods=2), 0.02, sample_rate=5e3, tolerance=1e-11)
        noise = 20e-9 * np.random.default_rng(0).standard_normal(walk["time"].size)
        walk["end_effector_position"] += noise
        walks.append(walk)
    found = compare_walks(
        walks[0],
        walks[1],
        model,
        walk_candidates(0.4, 1e6, 30.0)[:3],
        channel_free=("offset",),
        drive=Sawtooth(65.0, 100.0, periods=2),
        unseen_drive=Sawtooth(75.0, 100.0, periods=2),
        hops=0,
    )
    assert found.best == "CoulombViscous"
    assert found.fits["CoulombViscous"].values["sigma_2"] == pytest.approx(8.0, rel=0.1)
    assert found.fits["CoulombViscous"].aic < found.fits[CHANG_LI].aic < found.fits[POHL].aic
    assert found.table["verification_rmse"].attrs["units"] == "m"
    assert float(found.table["verification_rmse"].sel(law="CoulombViscous")) < 30e-9
    assert " m " in found.report()


def test_priors_of_a_candidate_count() -> None:
    """Viscous friction that is known to be half of what the walks show."""
    model = load_actuator("kang2007").replace(stage_reaction=False, friction=CoulombViscous(0.5, 8.0))
    drive = Sawtooth(65.0, 100.0, periods=2)
    walk = simulate(model, drive, 0.02, sample_rate=5e3, tolerance=1e-11)
    walk["end_effector_position"] += 20e-9 * np.random.default_rng(0).standard_normal(walk["time"].size)
    (law,) = (law for law in walk_candidates(0.4, 1e6, 30.0) if law.label == "CoulombViscous")
    laws = [law, law._replace(label="known", priors={"sigma_2": ("4 N s/m", "1e-3 N s/m")})]
    given = {"channel_free": (), "drive": drive, "unseen_drive": drive, "hops": 0, "noise": 20e-9}
    found = compare_walks(walk, walk, model, laws, **given)
    assert found.fits["known"].values["sigma_2"] == pytest.approx(4.0, abs=0.05)
    assert found.best == "CoulombViscous"


def test_slopes_by_differences_of_a_contact_that_rings_on() -> None:
    """Two elements that stick are a spring without hysteresis: 0.5 % of a stiffness is another phase."""
    law, drive = MaxwellSlip((9e5, 4e5), (0.25, 0.25), 3.0), Sawtooth(65.0, 20.0, periods=4)
    model = load_actuator("kang2007").replace(stage_reaction=False, friction=law)
    walk = simulate(model, drive, 0.2, sample_rate=2e3, tolerance=1e-11)
    walk["end_effector_position"] += 50e-9 * np.random.default_rng(0).standard_normal(walk["time"].size)
    names = ["stiffness_1", "stiffness_2"]
    fit = identify_friction(walk, model, names, drive=drive, hops=0, max_evaluations=2)
    assert fit.jacobian is not None
    for name, found in zip(names, fit.jacobian.T, strict=True):
        sides = [
            simulate(
                with_values(fit.model, {name: fit.values[name] * factor}),
                drive,
                0.2,
                sample_rate=2e3,
                tolerance=1e-14,
            )["end_effector_position"].values
            for factor in (1.0 - 1e-5, 1.0 + 1e-5)
        ]
        known = (sides[1] - sides[0]) / 2e-5
        assert np.linalg.norm(found - known) < 2e-3 * np.linalg.norm(known)


def test_searches_for_a_law_of_several_minima_end_and_say_how_many_agree() -> None:
    """A static law with a Stribeck curve, on a walk of LuGre: what remains free is what a walk shows."""
    true = load_actuator("kang2007").replace(stage_reaction=False)
    drives = [Sawtooth(volts, 20.0, periods=2) for volts in (65.0, 75.0)]
    walks = [simulate(true, drive, 0.1, sample_rate=2e3, tolerance=1e-10) for drive in drives]
    for walk in walks:
        noise = np.random.default_rng(1).standard_normal(walk["time"].size)
        walk["end_effector_position"] += 50e-9 * noise
    laws = [law for law in walk_candidates(0.5, 1.2e6, 30.0, starts=3) if law.label == "Stribeck"]
    found = compare_walks(
        walks[0],
        walks[1],
        true,
        laws,
        drive=drives[0],
        unseen_drive=drives[1],
        hops=0,
        bounds={"delay": (0.0, 2e-3)},
    )
    fit = found.fits["Stribeck"]
    assert fit.converged
    assert (fit.starts, fit.starts_agreeing) == (4, 4)
    # A fall shows a mean force and little of how it falls with speed.
    assert [line.split()[0] for line in fit.undetermined] == ["stiction_ratio", "stribeck_velocity"]
    assert "local minima" not in found.report()
