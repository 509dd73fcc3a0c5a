"""Joint fits of several walks, and where that begins whose stage is fixed: at the one with a free stage."""

from dataclasses import replace

import numpy as np
import pytest

import stickslip as ss
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.identify.walk.explained import TOGETHER, _ahead, explained
from stickslip.recording import make_recording

NAMES = ("friction", "slope", "stage")
START = [Parameter("friction", 1.0, 0.0, 3.0, "N", log=False), Parameter("slope", 2.0, 0.1, 90.0, "N/m")]
STAGE = Parameter("stage", 0.5, -9.0, 9.0, "m", log=False)


def line(seed: int) -> Residuals:
    """Linear in the coordinates of its three values, the second a logarithm; two of its columns alike."""
    random = np.random.default_rng(seed)
    columns = random.standard_normal((80, 3))
    columns[:, 2] = columns[:, 0] + 0.3 * columns[:, 1] + 0.2 * columns[:, 2]
    measured = columns @ [1.4, np.log(7.0), 0.2] + 0.01 * random.standard_normal(80)

    def of(values: dict[str, float]) -> np.ndarray:
        friction, slope, stage = (values[name] for name in NAMES)
        return columns @ [friction, np.log(slope), stage] - measured

    return Residuals(of, measured, None, "line", "m")


@pytest.mark.parametrize("stage", [-0.2, 0.2, 0.6])
def test_it_begins_where_a_linear_fit_ends(stage: float) -> None:
    loose = fit_least_squares([line(5)], [*START, STAGE])
    known = fit_least_squares([line(5)], [*START, STAGE._replace(start=stage, fixed=True)])
    ahead = _ahead(loose, {"stage": stage})
    assert set(ahead) == {"friction", "slope"}
    for name, value in ahead.items():
        assert value == pytest.approx(known.values[name], rel=1e-5)
        assert stage == 0.2 or value != pytest.approx(loose.values[name], rel=1e-2)


def test_it_stays_within_the_bounds() -> None:
    loose = fit_least_squares([line(5)], [*START, STAGE])
    assert _ahead(loose, {"stage": -8.0})["friction"] == 3.0


def test_without_derivatives_it_does_not_lead() -> None:
    loose = fit_least_squares([line(5)], [*START, STAGE])
    assert _ahead(replace(loose, jacobian=None), {"stage": 0.6}) == {}
    assert _ahead(replace(loose, jacobian=np.full((80, 3), np.nan)), {"stage": 0.6}) == {}


def test_an_offset_that_the_fit_found_by_itself_is_kept() -> None:
    model = ss.load_actuator("kang2007").replace(stage_reaction=False)
    walks, drives = [], []
    for i, volts in enumerate((65.0, 50.0)):
        drive = ss.waveform.Sequence(ss.waveform.Rest(0.1), ss.Sawtooth(volts, 5.0, periods=4))
        time = np.arange(0.0, 1.0, 1e-3)
        position = ss.simulate(model, drive, times=time)["end_effector_position"].values + 3e-7
        position = position + 2e-8 * np.random.default_rng(i).standard_normal(time.size)
        walks.append(make_recording(time, {"end_effector_position": position}, title=f"walk {i}"))
        drives.append(drive)
    free = ["sigma_0", "sigma_1", "coulomb_force"]
    fit = ss.identify_friction(walks[0], model, free, drive=drives[0])
    assert fit.values["offset"] == pytest.approx(3e-7, abs=1e-8)
    found = explained(fit, walks, drives, free)
    assert found.lacks[-1].name == TOGETHER
    assert not any(one.seen for one in found.lacks)
    assert found.known.values["coulomb_force"] == pytest.approx(model.friction.coulomb_force, rel=0.02)
