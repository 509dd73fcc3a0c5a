"""Trajectories that begin in a state, and that go on where another has ended."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest
import xarray as xr
from benchmarks.random_actuators import Member, member

import stickslip as ss
from stickslip.simulation.models import RelativeLoad
from stickslip.simulation.state import placed

KANG = ss.load_actuator("kang2007")
SECOND = ss.Actuator(
    gain=1.2e-7,
    natural_frequency=2 * math.pi * 900.0,
    damping_ratio=0.05,
    stage_mass=0.05,
    end_effector_mass=0.03,
    friction=ss.MaxwellSlip((1e6, 4e5), (0.2, 0.15), 0.5, 1.3, 1e-3, 900.0),
    external_force=0.1,
)
CASES: dict[str, tuple[Any, Any, float, dict[str, Any]]] = {
    # At this tolerance the whole and its parts are refined alike; only then are the steps the same.
    "periods are copied": (KANG, ss.Sawtooth(65.0, 5.0), 2.0, {"tolerance": 3e-9}),
    "a smooth drive": (KANG, ss.Sine(40.0, 31.0, offset=50.0), 0.3, {}),
    "a static law": (KANG.replace(friction=ss.Coulomb(0.54)), ss.Sawtooth(65.0, 50.0, 0.9), 0.1, {}),
    "branches and a normal force": (
        SECOND,
        ss.Sine(30.0, 71.0),
        0.1,
        {"load": ss.Sine(0.3, 40.0, offset=1.0)},
    ),
    "a sequence": (KANG, ss.Sawtooth(65.0, 40.0, 0.95, periods=3), 0.2, {}),
    "a pulled slider": (
        ss.physics.PulledSlider(0.3, 2e3, 1.0, ss.LuGre(1e5, 100.0, 0.4, 1.0, 1.4, 1e-3)),
        ss.waveform.Ramp(1e-3, 0.0, 2.0, unit="m"),
        0.6,
        {},
    ),
}


def whole_and_parts(
    model: Any, waveform: Any, duration: float, cut: float, **options: Any
) -> tuple[xr.Dataset, xr.Dataset, xr.Dataset]:
    times = np.linspace(0.0, duration, 161)
    early = times[times <= cut * duration]
    whole = ss.simulate(model, waveform, times=times, **options)
    first = ss.simulate(model, waveform, times=early, **options)
    late = np.append(early[-1], times[early.size :])
    return whole, first, ss.simulate(model, waveform, times=late, initial_state=first, **options)


@pytest.mark.parametrize("cut", [0.013, 0.5])
@pytest.mark.parametrize("name", CASES)
def test_goes_on_to_the_last_bit(name: str, cut: float) -> None:
    model, waveform, duration, options = CASES[name]
    whole, first, second = whole_and_parts(model, waveform, duration, cut, **options)
    n = first.time.size
    for variable in whole.data_vars:
        np.testing.assert_array_equal(second[variable], whole[variable][n - 1 :])
    # The last steps of the first part end where it does, and so are others.
    apart = np.abs(first.end_effector_position - whole.end_effector_position[:n])
    assert float(apart.max()) < 1e-9
    if first.attrs["error_estimate"] > 0.0:
        assert second.attrs["error_estimate"] > first.attrs["error_estimate"]


def moved(m: Member) -> float:
    """Into how many samples of a random actuator its trajectory can be cut: one for every seed."""
    return float(np.random.default_rng([3, m.number]).uniform(0.05, 0.95))


@pytest.mark.parametrize("number", [0, 4, 8])
def test_random_actuators_go_on_within_their_estimates(number: int) -> None:
    """To the last bit where both took the same steps; else both are as near to the truth as they say."""
    m = member(number, 3)
    whole, first, second = whole_and_parts(
        m.actuator, m.waveform, float(m.times[-1]), moved(m), load=m.load, tolerance=1e-9
    )
    apart = np.abs(second.end_effector_position - whole.end_effector_position[first.time.size - 1 :])
    allowed = sum(part.attrs["error_estimate"] for part in (whole, second))
    assert float(apart.max()) <= 3.0 * allowed


def test_survives_a_file(tmp_path: Any) -> None:
    first = ss.simulate(KANG, ss.Sawtooth(65.0, 5.0), 0.3)
    ss.save_recording(first, tmp_path / "first.nc")
    again = ss.read_recording(tmp_path / "first.nc")
    assert ss.simulation.final_state(again) == ss.simulation.final_state(first)
    second = [ss.simulate(KANG, ss.Sawtooth(65.0, 5.0), 0.3, initial_state=d) for d in (first, again)]
    np.testing.assert_array_equal(second[0].end_effector_position, second[1].end_effector_position)
    assert float(second[0].time[0]) == pytest.approx(0.3)
    assert float(second[0].time[-1]) == pytest.approx(0.6)


def test_state_of_ones_own() -> None:
    """A stage that is let go rings as a damped oscillator; the end-effector without friction flies."""
    free = KANG.replace(friction=ss.LuGre(1.0, 0.0, 0.0, 1e-12, 1e-12, 1e-3), stage_reaction=False)
    state = ss.simulation.State(stage_position=1e-6, stage_velocity=0.0, end_effector_velocity=2e-3)
    d = ss.simulate(free, ss.Constant(0.0), 0.01, sample_rate=2e4, initial_state=state, tolerance=1e-12)
    w, z = free.natural_frequency, free.damping_ratio
    damped, t = w * math.sqrt(1.0 - z * z), d.time.values
    rings = np.exp(-z * w * t) * (np.cos(damped * t) + z * w / damped * np.sin(damped * t)) * 1e-6
    np.testing.assert_allclose(d.stage_position, rings, atol=3e-12)
    np.testing.assert_allclose(d.end_effector_position, 2e-3 * t, atol=3e-11)


def test_a_drive_that_was_another_before_goes_on_from_the_state_itself() -> None:
    """Two drives of many samples look alike when printed; they differ just before the state."""
    t = np.linspace(0.0, 0.2, 4001)
    values = 20.0 + 10.0 * np.sin(40.0 * t)
    bent = values.copy()
    bent[1900:2100] += 20.0 * np.hanning(200)
    first = ss.simulate(KANG, ss.Sampled(t, values), 0.1)
    state, drive = ss.simulation.final_state(first), ss.Sampled(t, bent)
    found = ss.simulate(KANG, drive, 0.05, initial_state=first)
    expected = ss.simulate(KANG, drive, 0.05, initial_state=state._replace(resume=()))
    np.testing.assert_array_equal(found.end_effector_position, expected.end_effector_position)
    assert float(found.end_effector_position[0]) == state.end_effector_position


@pytest.mark.parametrize("second", [ss.Constant(60.0), ss.Sampled([0.0, 0.05, 0.1], [0.0, 150.0, 60.0])])
def test_what_the_piezo_remembers_of_another_drive_is_warned_of(second: Any) -> None:
    """Plays that a peak of 150 V has moved stay there at 60 V: a rest at 60 V since ever is another place."""
    model = ss.load_actuator("kang2007-hysteresis").replace(clamped=True)
    first = ss.simulate(model, ss.Sampled([0.0, 0.05, 0.1], [0.0, 150.0, 60.0]), 0.1)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        ss.simulate(model, second, 0.1, initial_state=first)
    texts = [str(one.message) for one in said]
    assert [("not the drive of initial_state (by up to 90 V)" in text) for text in texts] == (
        [True] if isinstance(second, ss.Constant) else []
    )


def test_energy_of_a_state() -> None:
    first = ss.simulate(KANG, ss.Sine(40.0, 50.0, offset=60.0), 0.033)
    d = ss.simulate(
        KANG, ss.Sine(40.0, 50.0, offset=60.0), 0.05, energy=True, initial_state=first, tolerance=1e-11
    )
    assert float(np.abs(d.energy_defect).max()) < 1e-4 * float(np.abs(d.drive_work).max())
    assert float(d.drive_work[0]) == 0.0


@pytest.mark.parametrize("cut", [0.1037])
def test_the_energy_account_costs_a_continuation_nothing(cut: float) -> None:
    """The same trajectory to the last bit; the account counts from where it goes on."""
    drive = ss.Sawtooth(65.0, 20.0)
    whole = ss.simulate(KANG, drive, times=np.linspace(0.0, 0.2, 201), energy=True)
    first = ss.simulate(KANG, drive, times=np.array([0.0, cut]))
    later = whole.sel(time=whole.time[whole.time > cut])
    second = ss.simulate(KANG, drive, times=later.time.values, energy=True, initial_state=first)
    np.testing.assert_array_equal(second.end_effector_position, later.end_effector_position)
    begun = ss.simulate(KANG, drive, times=np.array([0.0, cut]), energy=True).isel(time=-1)
    for name in ("drive_work", "stage_dissipation", "friction_work"):
        np.testing.assert_allclose(second[name] + float(begun[name]), later[name], rtol=1e-6, atol=1e-12)
    assert float(np.abs(second.energy_defect).max()) < 2.0 * float(np.abs(whole.energy_defect).max())


@pytest.mark.parametrize(
    ("state", "said"),
    [
        (ss.simulation.State(bristle_deflections=(0.0, 0.0)), "2 bristle deflections"),
        (ss.simulation.State(stage_velocity=math.nan), "finite"),
        (ss.simulation.State(time=-1.0), "0 s or later"),
    ],
)
def test_refused(state: ss.simulation.State, said: str) -> None:
    with pytest.raises(ss.QuantityError, match=said):
        ss.simulate(KANG, ss.Sawtooth(65.0, 5.0), 0.1, initial_state=state)


BOUNDED = [
    (ss.ResetIntegrator(1e6, 5e-7, 0.2, 5.0), (5e-7,)),
    (ss.MaxwellSlip((1e6, 4e5), (0.2, 0.15), 0.5, 1.3), (0.26e-6, 0.4875e-6)),
    (ss.Dahl(1e6, 0.5, 0.5), (5e-7,)),
]


@pytest.mark.parametrize(("law", "most"), BOUNDED, ids=repr)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_bristle_begins_far_beyond_its_bound(law: Any, most: tuple[float, ...], sign: float) -> None:
    model, at_bound = KANG.replace(friction=law), sign * np.array(most)
    for i, bound in enumerate(most):
        z = at_bound.copy()
        z[i] *= 2.1
        said = rf"deflections\[{i}\] = \S+ m is beyond .* {type(law).__name__}: at most {bound:g} m"
        with pytest.raises(ss.QuantityError, match=said):
            begun(model, z)
    # What friction that was greater by a fifth has left is put onto the bound; rounding is left alone.
    np.testing.assert_array_equal(begun(model, 1.2 * at_bound), at_bound)
    np.testing.assert_array_equal(begun(model, 1.001 * at_bound), 1.001 * at_bound)


def test_a_law_without_a_bound_takes_what_another_left() -> None:
    """The bristle lets go bit by bit: contacts of a rig differ from run to run."""
    assert begun(KANG.replace(friction=ss.LuGre(1e6, 30.0, 0.4, 0.5, 0.7)), np.array([8e-7]))[0] == 8e-7


def begun(model: Any, z: Any) -> Any:
    """The deflections with which a trajectory of the model begins in a state."""
    of = RelativeLoad().system(model)
    state = ss.simulation.State(bristle_deflections=tuple(z.tolist()))
    return placed(state, of, RelativeLoad(), 0.0)[of.bodies : of.inner]


def test_with_a_sample_rate_it_goes_on_at_the_same_instants() -> None:
    """51/1000 s, and not 0.05 s + 1/1000 s, which is another number."""
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 50.0)
    whole, first = (ss.simulate(model, drive, t) for t in (0.1, 0.05))
    second = ss.simulate(model, drive, 0.05, initial_state=first)
    np.testing.assert_array_equal(second.time, whole.time[50:])
    np.testing.assert_array_equal(second.end_effector_position, whole.end_effector_position[50:])
    odd = ss.simulate(model, drive, 0.05, initial_state=first, sample_rate=333.0)
    assert odd.time.values[0] == 0.05
