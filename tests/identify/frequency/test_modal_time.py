"""Free simulation of modal models against SciPy's solver of linear systems, and fits to it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from stickslip.estimate.problem import FitError
from stickslip.identify.frequency.in_time import held_response, identify_in_time
from stickslip.identify.frequency.modal import ModalModel

from . import modal_system as system

RATE, FINE = system.SAMPLE_RATE, 10


def model(delay: float, omega=system.OMEGA) -> ModalModel:
    return ModalModel(omega, system.ZETA, delay, system.GAIN, system.RATE_GAIN, system.REMAINDER)


def solved(drive: np.ndarray, delay_in_fine_steps: int) -> np.ndarray:
    """The held drive on a grid ten times finer, delayed there, through each mode by SciPy's lsim."""
    n = len(drive)
    fine = np.repeat(drive, FINE, axis=0)
    late = np.concatenate([np.zeros((delay_in_fine_steps, 2)), fine])[: len(fine)]
    t = np.arange(len(fine)) / (FINE * RATE)
    found = late @ system.REMAINDER.T
    for w, z, a, b in zip(system.OMEGA, system.ZETA, system.GAIN, system.RATE_GAIN, strict=True):
        for o in range(2):
            for i in range(2):
                lti = signal.lti([b[o, i] * w, a[o, i] * w**2], [1, 2 * z * w, w**2])
                found[:, o] += signal.lsim(lti, late[:, i], t, interp=False)[1]
    return found[::FINE][:n]


def test_held_response_solves_the_equations_of_motion() -> None:
    drive, steps = np.random.default_rng(1).standard_normal((100, 2)), 17
    found = held_response(model(steps / (FINE * RATE)), drive, RATE)
    expected = solved(drive, steps)
    assert found == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("steps", [3, 13, 23])
def test_a_response_that_leads_its_drive_contains_the_whole_drive(steps: int) -> None:
    """The steps are tenths of a sample. The drive keeps its last value."""
    drive, lead = np.random.default_rng(1).standard_normal((100, 2)), -(-steps // FINE)
    found = held_response(model(-steps / (FINE * RATE)), drive, RATE)
    longer = np.concatenate([drive, np.repeat(drive[-1:], lead, axis=0)])
    expected = solved(longer, lead * FINE - steps)[lead:]
    assert found == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


def test_without_delay_the_drive_acts_at_once_or_not_yet() -> None:
    """The remainder passes the value held before the instant: a drive never acts before it is there."""
    step = np.ones((4, 2))
    only = model(0.0)._replace(gain=0 * system.GAIN, rate_gain=0 * system.RATE_GAIN)
    assert held_response(only, step, RATE)[0] == pytest.approx(0)
    assert held_response(only, step, RATE)[1] == pytest.approx(system.REMAINDER.sum(axis=1))


def test_periodic_response_is_what_many_periods_lead_to() -> None:
    drive = np.random.default_rng(3).standard_normal((200, 2, 2))
    settled = held_response(model(1.3 / RATE), np.concatenate([drive] * 40), RATE)[-200:]
    steady = held_response(model(1.3 / RATE), drive, RATE, periodic=True)
    assert steady == pytest.approx(settled, abs=1e-12 * np.abs(settled).max())


@pytest.mark.parametrize("periodic", [False, True])
def test_modes_are_found_again(periodic: bool) -> None:
    rng = np.random.default_rng(2)
    drive = system.multisines(rng, 1600, 2)
    delay = 0.35 / RATE
    true = model(delay)
    if periodic:
        response = held_response(true, np.concatenate([drive] * 8), RATE)[-1600:]
    else:
        response = held_response(true, drive, RATE)
    response = response + 1e-9 * rng.standard_normal(response.shape)
    begin = model(delay + 0.5 / RATE, system.OMEGA * np.array([1.01, 0.99, 1.01]))
    fit = identify_in_time(drive, response, RATE, begin, periodic=periodic)
    assert fit.converged
    assert fit.model.delay == pytest.approx(delay)
    assert fit.model.natural_frequency == pytest.approx(system.OMEGA, rel=1e-5)
    assert fit.model.damping_ratio == pytest.approx(system.ZETA, rel=1e-3)
    assert fit.model.gain == pytest.approx(system.GAIN, abs=1e-9)
    assert fit.model.rate_gain == pytest.approx(system.RATE_GAIN, abs=1e-9)
    assert fit.rmse == pytest.approx(1e-9, rel=0.05)
    assert [g.name for g in fit.recordings] == ["output 1", "output 2"]
    z = (np.log(fit.model.natural_frequency) - np.log(system.OMEGA)) / [
        fit.standard_errors[f"natural_frequency_{m}"] / system.OMEGA[m - 1] for m in (1, 2, 3)
    ]
    assert np.all(np.abs(z) < 4)
    assert fit.values["gain_2[1,2]"] == fit.model.gain[1, 0, 1]
    again = held_response(fit.model, drive, RATE, periodic=periodic)
    assert fit.r_squared == pytest.approx(
        1
        - np.sum((again - response) ** 2)
        / np.sum((response - response.mean(axis=(0, 2), keepdims=True)) ** 2),
        abs=1e-7,
    )


def test_shapes_must_fit() -> None:
    drive = np.zeros((50, 2, 1))
    with pytest.raises(FitError, match="samples, channels, recordings"):
        identify_in_time(drive, drive[:40], RATE, model(0.0))
