"""Maps of the step: against motions that were waited for, symmetries, limits, and what is refused."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip import design
from stickslip.design.motion import measured, sample_times
from stickslip.physics.actuator import Actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import SimulationWarning
from stickslip.simulation import steady_members as engine
from stickslip.waveform import Constant, Cycloid

KANG = ss.load_actuator("kang2007")
TOLERANCE = 1e-10
F_C, SIGMA_0 = 0.5401, 1.399e6
LAWS = [
    ss.LuGre(SIGMA_0, 34.9, 0.0, F_C, 0.65),
    ss.Dahl(SIGMA_0, F_C),
    ss.Elastoplastic(SIGMA_0, 34.9, 0.0, F_C, 0.6, 0.2e-6),
    ss.MaxwellSlip((1e6, 4e5), (0.3, 0.24), 1.0),
]


def random_actuator(rng: np.random.Generator, law: Any) -> Actuator:
    return KANG.replace(
        friction=law,
        natural_frequency=float(rng.uniform(2e3, 1e4)),
        damping_ratio=float(rng.uniform(0.2, 0.7)),
        end_effector_mass=float(np.exp(rng.uniform(np.log(0.03), np.log(0.3)))),
        stage_reaction=bool(rng.integers(2)),
    )


def waited_for(model: Actuator, drive: Any, frequency: float) -> float:
    """Net step of the last of many periods."""
    n = 300
    late = ss.simulate(
        model, drive._replace(periods=n), times=[0.0, (n - 1) / frequency, n / frequency], tolerance=5e-11
    )
    return float(np.diff(late["end_effector_position"].values)[-1])


@pytest.mark.parametrize("seed", range(4))
def test_points_are_those_of_motions_that_were_waited_for(seed: int) -> None:
    rng = np.random.default_rng([17, seed])
    model = random_actuator(rng, LAWS[seed % 4])
    volts, hertz = rng.uniform(40.0, 140.0), float(np.exp(rng.uniform(np.log(20), np.log(300))))
    force, rise = rng.uniform(-0.1, 0.1), rng.uniform(0.85, 0.97)
    found = ss.step_map(
        model,
        ss.Sawtooth(1.0, 1.0, rise_fraction=float(rise)),
        voltage=[20.0, volts],
        frequency=[hertz],
        load=[0.0, force],
        direction=[1, -1],
    )
    assert found.net_step.dims == ("voltage", "frequency", "load", "direction")
    at = found.sel(voltage=volts, frequency=hertz, load=force)
    loaded = model.replace(external_force=float(force))
    forward = ss.Sawtooth(float(volts), hertz, rise_fraction=float(rise))
    back = forward._replace(amplitude=-float(volts), offset=float(volts))
    for direction, drive in ((1, forward), (-1, back)):
        one = at.sel(direction=direction)
        assert int(one.status) == 0, str(one.reason.item())
        assert float(one.net_step) == pytest.approx(waited_for(loaded, drive, hertz), abs=3 * TOLERANCE)
        assert float(one.speed) == pytest.approx(float(one.net_step) * hertz, rel=1e-12)


def test_a_load_is_positive_towards_x() -> None:
    found = ss.step_map(KANG, voltage=65.0, frequency=5.0, load=[-0.1, 0.0, 0.1], direction=[1, -1])
    forward, back = found.net_step.sel(direction=1).values, found.net_step.sel(direction=-1).values
    assert 0.0 < forward[0] < forward[1] < forward[2]  # towards +x, as the load
    assert back[0] < back[1] < back[2] < 0.0
    # What pushes along one way is against the other: mirror images of each other.
    np.testing.assert_allclose(back, -forward[::-1], atol=3 * TOLERANCE)
    uphill = KANG.replace(incline=0.05, external_force=-0.02)
    same = KANG.replace(external_force=-0.02 + 0.03 - KANG.end_effector_mass * 9.80665 * np.sin(0.05))
    one = ss.step_map(uphill, voltage=65.0, frequency=5.0, load=0.03)
    assert one.net_step.dims == ()
    assert float(one.net_step) == pytest.approx(
        float(ss.step_map(same, voltage=65.0, frequency=5.0).net_step), abs=3 * TOLERANCE
    )


@pytest.mark.parametrize("waveform", [Cycloid(60.0, 80.0, 0.9), ss.Sine(30.0, 80.0, offset=40.0)])
def test_mirrored_drives_walk_back_as_far(waveform: Any) -> None:
    rng = np.random.default_rng(3)
    model = random_actuator(rng, LAWS[0]).replace(min_voltage=-np.inf)
    found = ss.step_map(model, waveform, voltage=[40.0, 80.0], direction=[-1, 1])
    step = found.net_step.sel(direction=1).values
    np.testing.assert_allclose(found.net_step.sel(direction=-1).values, -step, atol=3 * TOLERANCE)
    known = np.abs(step) > 1e-8
    assert np.all(np.abs(found.inequality.values[known]) < 0.05)
    if isinstance(waveform, Cycloid):
        assert np.all(known)


def test_inequality_is_that_of_both_steps() -> None:
    found = ss.step_map(KANG, voltage=65.0, frequency=5.0, load=[0.0, -0.05], direction=[1, -1])
    forward, back = (np.abs(found.net_step.sel(direction=d).values) for d in (1, -1))
    np.testing.assert_allclose(
        found.inequality.values, (forward - back) / (0.5 * (forward + back)), rtol=1e-9
    )
    assert found.inequality.values[1] < -0.1


def test_knots_are_a_drive_like_any_other() -> None:
    """A sawtooth as knots, stretched in time and voltage, and mirrored."""
    knots = ss.PeriodicKnots((0.0, 0.009), (10.0, 40.0), 0.01)
    saw = ss.Sawtooth(30.0, 100.0, rise_fraction=0.9, offset=10.0)
    over = {"voltage": [30.0, 70.0], "frequency": [50.0, 200.0], "direction": [1, -1]}
    one, other = (ss.step_map(KANG, drive, **over).net_step.values for drive in (knots, saw))
    assert np.all(np.isfinite(other))
    np.testing.assert_allclose(one, other, atol=3 * TOLERANCE)


def test_other_fields_vary_by_name() -> None:
    found = ss.step_map(
        KANG,
        ss.Sawtooth(65.0, 50.0),
        parameters={"end_effector_mass": ["50 g", "0.1 kg"], "rise_fraction": [0.9, 0.95, 1.0]},
    )
    assert found.net_step.dims == ("end_effector_mass", "rise_fraction")
    assert found.end_effector_mass.attrs["units"] == "kg"
    at = ss.steady_step(KANG.replace(end_effector_mass=0.05), ss.Sawtooth(65.0, 50.0, rise_fraction=0.95))
    assert float(found.net_step[0, 1]) == pytest.approx(at, abs=3 * TOLERANCE)


def test_rest_to_rest_stick_bounds_the_speed() -> None:
    """A drive whose rise never breaks the contact, and ends at rest: at most sqrt(stroke F_C/m_e)/2."""
    stiff = KANG.replace(natural_frequency=3e4, damping_ratio=0.7, stage_reaction=False)
    rise, most = 0.9, F_C / stiff.end_effector_mass
    for volts in (30.0, 60.0, 100.0):
        stroke = stiff.gain * volts
        fastest = rise * np.sqrt(most / (2.0 * np.pi * stroke))  # of the cycloid's peak acceleration
        found = ss.step_map(
            stiff, Cycloid(1.0, 1.0, rise), voltage=volts, frequency=fastest * np.linspace(0.5, 0.98, 6)
        )
        assert np.all(found.status == 0)
        assert np.all(found.speed < 0.5 * np.sqrt(stroke * most))
        assert float(found.speed.max()) > 0.2 * np.sqrt(stroke * most)


def test_backlash_and_ringing_are_those_of_the_trajectory() -> None:
    model = KANG.replace(damping_ratio=0.15)
    drive = ss.Sawtooth(80.0, 40.0, rise_fraction=0.999)
    names: list[Any] = ["backlash", "backward_rate", "ringing", "ripple"]
    found = ss.step_map(model, drive, direction=[1, -1], quantities=names)
    times = np.append(0.0, np.linspace(30.0, 32.0, 40_001) / 40.0)
    late = ss.simulate(model, drive._replace(periods=34), times=times, tolerance=5e-11)
    x = late["end_effector_position"].values[1:]
    fallen = np.maximum.accumulate(x) - x
    assert float(found.backlash.sel(direction=1)) == pytest.approx(fallen.max(), rel=2e-3)
    period_of_x = x[:20_001]
    assert float(found.backward_rate.sel(direction=1)) == pytest.approx(
        design.backward_rate(period_of_x), rel=2e-3
    )
    d, period = x - model.gain * late["drive_voltage"].values[1:], np.arange(x.size) / 20_000.0
    d = d[int(np.argmax(fallen)) :][period[: x.size - int(np.argmax(fallen))] < 0.85]
    assert float(found.ringing.sel(direction=1)) == pytest.approx(
        (np.maximum.accumulate(d) - d).max(), rel=0.02
    )
    uniform = np.linspace(0.0, 2.0 * float(found.net_step.sel(direction=1)), x.size)
    assert float(found.ripple.sel(direction=1)) == pytest.approx(np.ptp(x - uniform), rel=2e-3)
    for name in names:
        both = found[name].values
        assert both[0] == pytest.approx(both[1], rel=1e-3)
    damped = ss.step_map(model.replace(damping_ratio=1.2), drive, quantities=["ringing"])
    assert float(damped.ringing) < 0.05 * float(found.ringing[0])


def test_backlash_and_ringing_of_a_motion_that_is_known() -> None:
    """A walk of 1 per period, back by 3 between 0.2 and 0.4, then ahead of the stroke by 2.93 at 0.5 and by 1
    at 1.0."""
    t = np.linspace(0.0, 1.0, 1001)[:-1]
    x = np.interp(t, [0.0, 0.2, 0.4, 0.5, 0.6, 1.0], [0.0, 2.0, -1.0, 0.0, -0.5, 1.0])
    u = np.interp(t, [0.0, 0.2, 0.3, 1.0], [0.0, 1.0, -4.1, 0.0])
    backlash, ringing = measured(t, 1.0, x[None], u[None], np.array([1.0]))
    assert backlash[0] == pytest.approx(3.0, abs=0.01)
    assert ringing[0] == pytest.approx(4.1 * 0.5 / 0.7 - 1.0, abs=0.01)
    against = measured(t, 1.0, x[None], -u[None], np.array([1.0]))
    assert np.isnan(against[1][0])


def test_sample_times_are_close_behind_breaks() -> None:
    times = sample_times(np.array([0.0, 0.9]), 1.0, 1e3)
    assert times[0] == 0.0
    assert 0.999 < times[-1] < 1.0
    near = np.diff(times[(times >= 0.9) & (times < 0.905)])
    assert near.max() <= 2e-3 * np.pi / 32 * 1.01
    assert np.all(np.diff(times) > 0.0)
    assert np.diff(times).max() < 0.03


def test_current_energy_and_heat() -> None:
    stack = ss.physics.electronics.Stack(1.8e-6, 0.02, 8.0, 150.0, 20.0, 5.0)
    drive = ss.Sawtooth(65.0, 50.0, rise_fraction=0.9)
    found = ss.step_map(KANG, drive, voltage=[30.0, 65.0], frequency=[50.0, 200.0], stack=stack)
    for volts, hertz in itertools.product([30.0, 65.0], [50.0, 200.0]):
        one, at = drive._replace(amplitude=volts, frequency=hertz), found.sel(voltage=volts, frequency=hertz)
        run = ss.physics.electronics.electrical(one, stack, 1.0 / hertz)
        assert float(at.peak_current) == pytest.approx(float(run.peak_current), rel=1e-3)
        assert float(at.rms_current) == pytest.approx(float(run.rms_current), rel=1e-3)
        assert float(at.heat) == pytest.approx(float(run.mean_loss), rel=1e-3)
        loss = float(run.mean_loss) / hertz
        assert float(at.energy_per_step) == pytest.approx(0.5 * stack.load * volts**2 + loss, rel=1e-3)
        assert float(at.temperature_rise) == pytest.approx(20.0 * float(at.heat))
    knots = ss.PeriodicKnots((0.004, 0.013), (65.0, 0.0), 0.02)  # cycles that do not begin at an end
    begun = ss.step_map(KANG, knots, frequency=[50.0, 100.0], stack=stack)
    per_cycle = float(stack.cycle_loss(65.0))
    np.testing.assert_allclose(begun.heat.values, per_cycle * np.array([50.0, 100.0]), rtol=1e-9)
    with pytest.raises(QuantityError, match="Sawtooth jumps by 65 V"):
        ss.step_map(KANG, ss.Sawtooth(65.0, 5.0), stack=stack)


def test_points_out_of_range_say_why_and_leave_the_others() -> None:
    found = ss.step_map(KANG, voltage=[0.0, 100.0, 151.0], frequency=50.0)
    assert found.status.values.tolist() == [0, 0, 4]
    assert "takes 0 V to 150 V" in str(found.reason.values[2])
    assert np.isnan(found.net_step.values[2])
    assert abs(float(found.net_step[0])) < TOLERANCE
    high = KANG.replace(min_voltage=20.0)
    assert "offset=20.0" in ss.step_map(high, voltage=[50.0], frequency=50.0).attrs["waveform"]


def test_what_is_done_before_an_interruption_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "BLOCK", 4)
    told: list[float] = []

    def stop(doing: str, done: float) -> None:
        told.append(done)
        if len(told) == 3:
            raise KeyboardInterrupt

    over = {"voltage": np.linspace(10.0, 100.0, 5), "frequency": [20.0, 50.0, 80.0, 200.0]}
    with pytest.warns(SimulationWarning, match="stopped: 8 of 20 points"):
        found = ss.step_map(KANG, **over, threads=1, progress=stop)
    assert found.attrs["interrupted"] == 1
    left = found.status.values == found.status.attrs["flag_meanings"].split().index("not_computed")
    assert left.sum() == 8
    assert set(found.reason.values[left].tolist()) == {"not computed"}
    assert np.all(np.isnan(found.net_step.values[left]))
    whole = ss.step_map(KANG, **over, progress=lambda doing, done: told.append(done))
    np.testing.assert_array_equal(found.net_step.values[~left], whole.net_step.values[~left])
    assert told[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"voltage": [65.0]}, "frequency"),
        ({"voltage": ["5 N"], "frequency": [1.0]}, "voltage"),
        ({"voltage": [5.0, 5.0], "frequency": [1.0]}, "twice"),
        ({"voltage": [], "frequency": [1.0]}, "voltage"),
        ({"voltage": 5.0, "frequency": 1.0, "direction": [0.5]}, "it is 1"),
        ({"voltage": 5.0, "frequency": 1.0, "parameters": {"load": [1.0]}}, "normal_load"),
        ({"voltage": 5.0, "frequency": 1.0, "parameters": {"sigma0": [1.0]}}, "sigma_0"),
        ({"voltage": 5.0, "frequency": 1.0, "parameters": {"amplitude": [1.0]}}, "the same"),
        ({"waveform": Constant(1.0), "load": [0.1]}, "periodic"),
        ({"waveform": Constant(1.0), "voltage": [0.1]}, "no amplitude"),
        ({"waveform": ss.Sawtooth(1.0, 1.0), "quantities": ["bakclash"]}, "bakclash"),
        ({"waveform": ss.Sawtooth(1.0, 1.0), "fit": 3}, "Posterior"),
    ],
)
def test_what_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        ss.step_map(KANG, given.pop("waveform", None), **given)
