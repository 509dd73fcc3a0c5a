"""An actuator with hysteresis and creep: against the plain one under what its piezo makes of the drive."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import reference
import stickslip as ss
from stickslip.physics.piezo import BoucWen, Creep, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.waveform.drive import evaluate

PLAIN = ss.load_actuator("kang2007")
HYSTERESIS = PrandtlIshlinskii((0.0, 3.0, 8.0, 15.0), (0.8, 0.08, 0.08, 0.04), (20.0, 40.0), (-0.02, -0.02))
BENT = PLAIN.replace(piezo=Piezo(HYSTERESIS))
CREEPING = PLAIN.replace(piezo=Piezo(HYSTERESIS, Creep.logarithmic(0.02, 0.1, 10.0)))


def test_a_linear_piezo_changes_nothing() -> None:
    drive = ss.Sawtooth(65.0, 5.0)
    linear = PLAIN.replace(piezo=Piezo(PrandtlIshlinskii((0.0,), (1.0,))))
    one, other = (ss.simulate(a, drive, 0.5) for a in (PLAIN, linear))
    np.testing.assert_allclose(one.end_effector_position, other.end_effector_position, atol=1e-9)


def test_it_moves_as_the_plain_one_under_samples_of_its_stroke() -> None:
    """A drive of lines: between the corners its stroke is lines too, so that the samples are exact."""
    random = np.random.default_rng(0)
    corners = np.sort(random.choice(np.arange(1, 200), 12, replace=False)) * 1e-3
    drive = ss.Sampled(np.append(0.0, corners), np.append(0.0, random.uniform(0.0, 90.0, 12)))
    times = np.linspace(0.0, 0.2, 200_001)
    stroke = reference.prandtl_ishlinskii(HYSTERESIS, evaluate(drive.drive(1.0), times)[0], 0.0)
    plain = ss.simulate(PLAIN, ss.Sampled(times, stroke), 0.2, tolerance=1e-9)
    found = ss.simulate(BENT, drive, 0.2, tolerance=1e-9)
    assert found.attrs["error_estimate"] < 1e-9
    np.testing.assert_allclose(found.end_effector_position, plain.end_effector_position, atol=3e-9)
    np.testing.assert_allclose(found.drive_voltage, evaluate(drive.drive(1.0), found.time.values)[0])


def test_hysteresis_opens_the_loop_of_a_slow_stage() -> None:
    """A quasi-static sine: the stage follows C H[u], and turns back late."""
    drive = ss.Sine(30.0, 2.0, offset=35.0)
    found = ss.simulate(BENT.replace(clamped=True), drive, 1.5, sample_rate=2e4)
    stroke = reference.prandtl_ishlinskii(HYSTERESIS, found.drive_voltage.values, 35.0)
    at_once = BENT.gain * np.interp(
        found.time - 2.0 * BENT.damping_ratio / BENT.natural_frequency, found.time, stroke
    )
    late = np.abs(found.stage_position.values - at_once)[1000:]
    assert late.max() < 2e-9
    loop = found.stage_position.values[10_000:20_000] - BENT.gain * found.drive_voltage.values[10_000:20_000]
    assert np.ptp(loop) > 0.05 * BENT.gain * 60.0


@pytest.mark.parametrize("actuator", [BENT, CREEPING], ids=["hysteresis", "creep"])
def test_steady_step_is_that_of_a_long_walk(actuator: ss.Actuator) -> None:
    drive = ss.Sawtooth(65.0, 20.0)
    step = ss.steady_step(actuator, drive)
    walk = ss.simulate(
        actuator, drive, 60.0 if actuator.piezo.creep else 2.0, sample_rate=20.0, tolerance=1e-8
    )
    last = float(walk.end_effector_position[-1] - walk.end_effector_position[-2])
    assert step == pytest.approx(last, abs=2e-10)
    assert abs(step - ss.steady_step(PLAIN, drive)) > 1e-7


def test_members_are_single_runs() -> None:
    """Of the model's values, and of the waveform's."""
    drive, amplitudes = ss.Sawtooth(65.0, 20.0), np.array([40.0, 65.0, 80.0])
    masses = np.array([0.05, 0.1, 0.2])
    many = ss.simulate_ensemble(
        BENT, drive, 0.3, parameters={"end_effector_mass": masses, "amplitude": amplitudes}
    )
    for m, (mass, amplitude) in enumerate(zip(masses, amplitudes, strict=True)):
        one = ss.simulate(BENT.replace(end_effector_mass=mass), drive._replace(amplitude=amplitude), 0.3)
        expected = float(one.end_effector_position[-1])
        assert float(many.net_displacement[m]) == pytest.approx(expected, abs=3e-9)
    steps = ss.steady_steps(BENT, drive, parameters={"amplitude": amplitudes})
    for m, amplitude in enumerate(amplitudes):
        expected = ss.steady_step(BENT, drive._replace(amplitude=amplitude))
        assert float(steps.net_step[m]) == pytest.approx(expected, abs=3e-10)


def test_derivatives_are_differences() -> None:
    drive, names = ss.Sawtooth(65.0, 20.0), ["gain", "end_effector_mass", "amplitude"]
    found = ss.simulation.sensitivities(BENT, drive, 0.2, parameters=names, tolerance=1e-11)

    def end(actuator: ss.Actuator, waveform: ss.Sawtooth) -> float:
        return float(ss.simulate(actuator, waveform, 0.2, tolerance=1e-12).end_effector_position[-1])

    for name in names:
        if name == "amplitude":
            h = 1e-3
            pair = [end(BENT, drive._replace(amplitude=65.0 + d)) for d in (h, -h)]
        else:
            h = 1e-4 * getattr(BENT, name)
            pair = [end(BENT.replace(**{name: getattr(BENT, name) + d}), drive) for d in (h, -h)]
        difference = (pair[0] - pair[1]) / (2.0 * h)
        assert float(found["derivative"].sel(parameter=name)[-1]) == pytest.approx(difference, rel=2e-3)


def test_a_run_is_taken_up_again() -> None:
    drive = ss.Sawtooth(65.0, 5.0)
    whole = ss.simulate(CREEPING, drive, 0.7)
    first = ss.simulate(CREEPING, drive, 0.3)
    rest = ss.simulate(CREEPING, drive, 0.4, initial_state=first)
    assert float(rest.end_effector_position[-1]) == pytest.approx(
        float(whole.end_effector_position[-1]), abs=1e-9
    )


def test_what_is_no_piezo_is_refused() -> None:
    with pytest.raises(QuantityError, match="must be Piezo or None"):
        PLAIN.replace(piezo=HYSTERESIS)
    with pytest.raises(
        QuantityError, match="out of range: kang2007 takes"
    ):  # the voltage, not what comes of it
        ss.simulate(BENT, ss.Sawtooth(2.0 * PLAIN.max_voltage, 5.0), 0.1)


KNOTS = ss.PeriodicKnots((0.0, 3e-4, 5.5e-4, 8e-4, 9e-4), (0.0, 20.0, 45.0, 65.0, 30.0), 1e-3, smooth=True)


@pytest.mark.parametrize(
    ("hysteresis", "drive", "end"),
    [(BoucWen(0.4, 0.01, 0.002), ss.Sine(30.0, 50.0, offset=35.0), 0.04), (None, KNOTS, 0.004)],
    ids=["Bouc-Wen", "creep alone"],
)
def test_the_error_estimate_contains_that_of_the_drive(
    hysteresis: BoucWen | None, drive: ss.Sine, end: float
) -> None:
    """The clamped stage is linear, and known to rounding for the drive that slow integration gives."""
    creep = Creep((2e-3, 0.3), (0.05, 0.1))
    one = PLAIN.replace(clamped=True, piezo=Piezo(hysteresis, creep))
    times, fine = np.linspace(0.0, end, 81), np.linspace(0.0, end, 20_001)
    volts = evaluate(drive.drive(1.0), fine)[0]
    stroke = volts if hysteresis is None else reference.bouc_wen(hysteresis, volts, float(volts[0]))
    crept = CubicSpline(fine, stroke)
    for tau, share in zip(*creep, strict=True):
        stroke = stroke + share * reference.lagged(crept, tau, float(crept(0.0)), fine)
    u, w = CubicSpline(fine, stroke), one.natural_frequency
    exact = solve_ivp(
        lambda t, q: [q[1], w * w * (one.gain * u(t) - q[0]) - 2.0 * one.damping_ratio * w * q[1]],
        (0.0, times[-1]),
        [one.gain * float(u(0.0)), 0.0],
        "DOP853",
        times,
        rtol=1e-11,
        atol=1e-17,
        max_step=5e-4 * end,
    ).y[0]
    found = ss.simulate(one, drive, times=times, tolerance=1e-12)
    off = float(np.abs(found.stage_position.values - exact).max())
    assert off < 1e-12
    assert off < 3.0 * found.attrs["error_estimate"] + 1e-13
