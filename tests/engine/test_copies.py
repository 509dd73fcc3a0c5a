"""Periods that are copied: samples, work and continuation are those of the periods themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest

import stickslip as ss
from engine import cases
from engine.library import integrate
from stickslip.engine import binding
from stickslip.engine.outcome import DONE

PERIODIC = cases.cases()["periods that repeat"]


def test_a_slider_that_sticks_to_a_stage_without_dynamics_follows_the_drive() -> None:
    """In each period, however its instants are rounded."""
    stage = cases.KANG.replace(
        natural_frequency=math.inf, blocked_force_per_volt=1.0, friction=ss.Coulomb(50.0)
    )
    waveform = ss.PeriodicKnots(
        (0.0, 0.01), (0.0, 60.0), 1.0 / 37.0, smooth=True
    )  # begins and turns smoothly
    case = cases.model(stage, waveform, 12.0 / 37.0, samples=301)
    found = cases.answer(case, None)
    assert found.accepted < 100  # most of the periods are copies
    rides = abs(case.plant.elements[0].drive_rate or 0.0)
    assert 0.1 < np.ptp(found.samples[:, 0]) / (60.0 * rides) < 1.01
    expected = rides * waveform.value(case.times)
    np.testing.assert_allclose(found.samples[:, 0], expected, rtol=0.0, atol=1e-15)


def test_each_copied_period_takes_the_same_work() -> None:
    """Also where it ends with the run, however that instant is rounded."""
    waveform = ss.Sawtooth(65.0, 37.0, 0.9)
    for periods in range(20, 40):
        case = cases.model(cases.KANG, waveform, periods / 37.0, samples=periods + 1, energy=True)
        found = cases.answer(case, None)
        work = np.diff(found.account, axis=0)[10:]
        assert np.all(work[:, 1] > 0.0)
        np.testing.assert_allclose(work, np.broadcast_to(work[0], work.shape), rtol=1e-6)


def followed(case: cases.Case, row: np.ndarray, q: np.ndarray, end: float) -> None:
    outcome, *_ = integrate(
        *(case.plant, case.drive, case.load, q, (0.0, end), case.tolerance, False, 200_000),
        *(np.zeros(0), case.room[:0]),
        resume=row,
    )
    assert outcome == DONE


@pytest.mark.parametrize("periods", [1.5, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0, 6.5, 7.0, 9.0])
def test_a_run_goes_on_from_one_of_its_last_periods(periods: float) -> None:
    """Wherever it ended: before, at and after the period from which on all are copies."""
    case = PERIODIC._replace(samples=2)
    whole = cases.answer(case, None)
    row = np.zeros(binding.ComposedPlant(case.plant).resume_size)
    followed(case, row, case.state.copy(), periods / 50.0)
    assert (min(periods, 3.0) - 2.0) / 50.0 <= row[2] <= periods / 50.0
    q = np.full(case.state.size, np.nan)
    followed(case, row, q, case.end)
    expected = case.state.copy()
    followed(case, np.zeros(row.size), expected, case.end)
    np.testing.assert_array_equal(q, expected)
    np.testing.assert_allclose(q[:4:2], whole.state[:4:2], rtol=0.0, atol=case.tolerance)


@pytest.mark.parametrize("begin", [0.0, 0.005, 0.018, 0.02])
def test_copies_wherever_a_run_begins(begin: float) -> None:
    """In a segment of the drive, at the start of one, or of a period."""
    case = PERIODIC
    q = case.state.copy()
    span, tight = (begin, case.end), 0.01 * case.tolerance
    further = (False, 200_000, np.zeros(0), case.room[:0])
    coarse = integrate(case.plant, case.drive, case.load, q, span, case.tolerance, *further)
    fine = case.state.copy()
    integrate(case.plant, case.drive, case.load, fine, span, tight, *further)
    np.testing.assert_allclose(q[:4:2], fine[:4:2], rtol=0.0, atol=case.tolerance)
    assert coarse[2] < 2500


def test_a_careful_run_does_not_know_what_time_it_is() -> None:
    """It is as careful as its duration asks for."""
    case, late = cases.cases()["a careful run"], 8.0
    steps = []
    for begin in (0.0, late):
        drive = case.drive._replace(start=case.drive.start + begin)
        load = case.load._replace(start=case.load.start + begin)
        span = (begin, begin + case.end)
        *_, accepted, rejected = integrate(
            *(case.plant, drive, load, case.state.copy(), span, case.tolerance, True, 200_000),
            *(np.zeros(0), case.room[:0]),
        )
        steps.append(accepted + rejected)
    assert steps[0] > 15
    assert steps[1] == pytest.approx(steps[0], rel=0.05)


def test_a_run_without_periods_goes_on_from_its_last_segment() -> None:
    values = np.random.default_rng(5).uniform(0.0, 60.0, 31)
    case = cases.model(cases.KANG, ss.Sampled(np.linspace(0.0, 0.03, 31), values), 0.03)
    row = np.zeros(binding.ComposedPlant(case.plant).resume_size)
    for end in (0.0105, 0.0217, 0.0258):
        row[:] = 0.0
        followed(case, row, case.state.copy(), end)
        assert end - end % 1e-3 <= row[2] < end


def test_a_run_with_more_steps_than_its_log_has_rows() -> None:
    """No period ends before; each sample is there."""
    case = cases.model(cases.KANG, ss.waveform.Chirp(40.0, 20.0, 400.0, 0.5), 0.5, samples=400)
    whole = cases.answer(case, None)
    assert whole.accepted > 2 * 1024
    alone = cases.answer(case._replace(samples=2), None)
    assert whole[:4] == alone[:4]
    np.testing.assert_array_equal(whole.samples[-1], alone.samples[-1])
    steps = np.abs(np.diff(whole.samples[:, 0]))
    assert steps.min() > 0.0
    assert steps.max() < 1e-5


def test_a_sample_at_a_jump_of_the_load_is_the_one_after_it() -> None:
    """Where the normal force doubles, the force stays and the deflection is halved."""
    case = cases.model(
        cases.KANG, ss.Sine(50.0, 80.0), 0.02, load=ss.Sampled([0.0, 0.0125], [1.0, 2.0], "hold"), samples=17
    )
    found, just_before = cases.answer(case, None), case._replace(end=0.0125 - 1e-9, samples=2)
    before = cases.answer(just_before, None).state[-1]
    assert case.times[10] == 0.0125
    assert abs(before) > 1e-9
    assert found.samples[10, 4] == pytest.approx(0.5 * before, rel=1e-3)
