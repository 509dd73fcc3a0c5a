"""End stops: bounces of known speeds, a rest that ends with its push, and a walk that meets a stop."""

from __future__ import annotations

import numpy as np
import pytest

import stickslip as ss
from stickslip.physics import EndStops, PulledSlider
from stickslip.simulation import State, simulate

MASS, STIFFNESS, PUSH = 0.1, 50.0, 1.0  # kg, N/m, N
RESTITUTION = 0.6
BALL = PulledSlider(MASS, STIFFNESS, 0.0, ss.Coulomb(1e-9), external_force=-PUSH)
STOPS = EndStops(0.0, 1.0, RESTITUTION)
DROP = State(end_effector_position=5e-3, end_effector_velocity=0.0)


def test_bounces_lose_what_the_restitution_says_and_end_in_a_rest() -> None:
    found = simulate(BALL, ss.Constant(0.0, "m"), 0.4, sample_rate=1e4, end_stops=STOPS, initial_state=DROP)
    fall = np.sqrt((2.0 * PUSH * 5e-3 + STIFFNESS * 5e-3**2) / MASS)
    speeds = -found["impact_velocity"].values
    assert speeds.size > 20
    np.testing.assert_allclose(speeds[:12], fall * RESTITUTION ** np.arange(12), rtol=1e-5)
    omega, level = np.sqrt(STIFFNESS / MASS), -PUSH / STIFFNESS
    first = np.arccos(-level / (5e-3 - level)) / omega
    flights = 2.0 / omega * np.arctan(speeds[:12] * RESTITUTION / omega / -level)
    times = first + np.append(0.0, np.cumsum(flights))
    np.testing.assert_allclose(found["impact_time"].values[:13], times, atol=1e-8)
    rest = found.sel(time=slice(float(found["impact_time"][-1]) + 1e-4, None))
    assert rest.sizes["time"] > 1000
    assert np.all(rest["end_effector_position"] == 0.0)
    assert np.all(rest["end_effector_velocity"] == 0.0)
    assert found.attrs["error_estimate"] < 1e-9


def test_a_rest_ends_when_the_spring_pulls_the_body_off() -> None:
    """A force that grows in proportion to time after the release: the position is a ramp less a sine."""
    ramp = ss.Sampled([0.0, 1.0], [0.0, 0.1], unit="m")  # 0.02 m, where the spring carries the push, at 0.2 s
    found = simulate(
        BALL, ramp, 0.25, sample_rate=1e4, end_stops=STOPS, initial_state=State(end_effector_position=0.0)
    )
    t, omega = found["time"].values, np.sqrt(STIFFNESS / MASS)
    since = np.maximum(t - 0.2, 0.0)
    np.testing.assert_allclose(
        found["end_effector_position"], 0.1 * (since - np.sin(omega * since) / omega), atol=1e-9
    )
    assert np.all(found["end_effector_position"].values[t < 0.19999] == 0.0)
    assert found["impact_velocity"].size == 0


def test_a_walk_ends_at_a_stop_and_returns_from_it() -> None:
    actuator, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 20.0)
    stops = EndStops(-5e-6, 15e-6, 0.2)
    free = simulate(actuator, drive, 0.4, sample_rate=1e4, tolerance=1e-8)
    found = simulate(actuator, drive, 0.4, sample_rate=1e4, tolerance=1e-8, end_stops=stops)
    x = found["end_effector_position"].values
    before = found["time"].values < float(found["impact_time"][0])
    assert float(free["end_effector_position"][-1]) > 1.5 * stops.high
    np.testing.assert_allclose(x[before], free["end_effector_position"].values[before], atol=2e-8)
    assert x.max() == stops.high
    assert np.all(found["impact_velocity"] > 0.0)
    assert x[-1000:].min() > stops.high - actuator.gain * 65.0  # it stays within a stroke of the stop
    back = simulate(
        actuator, ss.ReverseSawtooth(65.0, 20.0), 0.8, sample_rate=1e4, tolerance=1e-8, end_stops=stops,
        initial_state=ss.simulation.final_state(found),
    )  # fmt: skip
    assert float(back["end_effector_position"][-1]) < stops.high - 1e-6


def test_an_elastic_stop_keeps_the_energy() -> None:
    found = simulate(
        BALL, ss.Constant(0.0, "m"), 1.0, times=[0.5, 1.0], end_stops=STOPS._replace(restitution=1.0),
        initial_state=DROP,
    )  # fmt: skip
    speeds = -found["impact_velocity"].values
    assert speeds.size > 8
    np.testing.assert_allclose(speeds, speeds[0], rtol=1e-5)


def test_stops_that_cannot_be_are_refused() -> None:
    with pytest.raises(ss.QuantityError, match="must be below high"):
        EndStops(1.0, 0.0)
    with pytest.raises(ss.QuantityError, match="exclude the start at"):
        simulate(BALL, ss.Constant(0.0, "m"), 0.1, end_stops=EndStops(0.1, 0.2))
    actuator, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 20.0)
    for model, more, said in (
        (actuator, {"energy": True}, "energy account"),
        (actuator.replace(clamped=True), {}, "clamped"),
        (actuator.replace(friction=ss.Coulomb(0.5)), {}, "a law with bristles"),
    ):
        with pytest.raises(ss.QuantityError, match=said):
            simulate(model, drive, 0.1, end_stops=EndStops(-1e-3, 1e-3), **more)  # type: ignore[arg-type]
    with pytest.raises(ss.QuantityError, match="end_stops"):
        simulate(actuator, drive, 0.1, end_stops=(0.0, 1.0))


def test_stops_are_along_the_coordinate_of_the_model() -> None:
    """An actuator that turns meets stops at angles; lengths are refused, also as plain numbers."""
    model, drive = ss.load_actuator("kang2007").replace(rotary=True), ss.Sawtooth(65.0, 20.0)
    stops = EndStops("-5 mrad", "1 deg", rotary=True)
    assert stops.high == pytest.approx(np.pi / 180.0)
    assert "mrad" in str(stops)
    found = simulate(model, drive, 0.1, end_stops=stops)
    assert found["end_effector_position"].attrs["units"] == "rad"
    with pytest.raises(ss.QuantityError, match=r"EndStops\.low = '-5 mm'"):
        EndStops("-5 mm", "5 mm", rotary=True)
    with pytest.raises(ss.QuantityError, match=r"low = 1 rad must be below high = 0 rad"):
        EndStops(1.0, 0.0, rotary=True)
    for wrong, of in ((EndStops("-5 mm", "5 mm"), model), (stops, model.replace(rotary=False))):
        with pytest.raises(ss.QuantityError, match=rf"the model moves in .* rotary={of.rotary}"):
            simulate(of, drive, 0.1, end_stops=wrong)
