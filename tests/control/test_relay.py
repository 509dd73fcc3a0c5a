"""Autotuning by a relay against the Bode diagram of the model."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.control import Pid, Regulator, Relay, simulate_control
from stickslip.control.loops import grid, sampled_loop
from stickslip.control.tuning import margins
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError, to_si
from stickslip.rig import Channel, Limits, VirtualRig, load_bench, regulate

KANG = load_actuator("kang2007")
RATE = 20e3


def ultimate(delay: int) -> float:
    """The integral gain whose loop has the gain margin 1, by the loop's response."""
    return 1e9 * margins(Regulator(Pid(1e9), RATE), [sampled_loop(KANG, RATE, delay=delay)]).gain_margin


@pytest.mark.parametrize("delay", [0, 2])
def test_the_describing_function_finds_the_gain_of_the_bode_diagram(delay: int) -> None:
    """Third harmonics are 3 % of the first behind a stage and an integrator."""
    relay = Relay("1 kV/s", RATE, "40 V")
    found = simulate_control(KANG, relay, 0.0, 1.0, rate=RATE, delay=delay)
    told = relay.found
    assert told.ultimate == pytest.approx(ultimate(delay), rel=0.03)
    x = found["end_effector_position"].values[-2000:]
    assert told.amplitude == pytest.approx(0.5 * np.ptp(x), rel=0.05)
    spectrum = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size)))
    assert told.frequency == pytest.approx(np.argmax(spectrum) * RATE / x.size, abs=RATE / x.size)
    pid = told.pid(2.5)
    loop = sampled_loop(KANG, RATE, delay=delay)
    assert margins(Regulator(pid, RATE), [loop]).gain_margin == pytest.approx(2.5, rel=0.03)


def test_on_a_linear_loop_it_is_where_the_describing_function_says() -> None:
    """Tick by tick of the sampled stage; the frequency is that of the phase of -90 degrees."""
    loop = sampled_loop(KANG, RATE, delay=1)
    relay, x, found = Relay(1e3, RATE, 40.0, periods=10), np.zeros(loop.b.size), []
    while not relay.done:
        found.append(float(loop.c @ x))
        x = loop.a @ x + loop.b * relay.step(found[-1], 0.0, 0)
    told, swing = relay.found, np.array(found[-600:])
    assert told.ultimate == pytest.approx(ultimate(1), rel=0.03)
    turns = 2.0 * np.pi * told.frequency / RATE * np.arange(swing.size)
    columns = np.column_stack([np.ones(swing.size), np.cos(turns), np.sin(turns)])
    _, *first = np.linalg.lstsq(columns, swing, rcond=None)[0]
    assert told.amplitude == pytest.approx(np.hypot(*first), rel=2e-3)
    assert told.amplitude == pytest.approx(0.5 * np.ptp(swing), rel=0.03), "higher harmonics are small"
    phase = np.unwrap(np.angle(loop.response)) + np.pi * grid(RATE) / RATE  # a sum is half a tick early
    at = np.interp(np.pi / 2.0, -phase, grid(RATE))
    assert told.frequency == pytest.approx(at, rel=0.03)
    assert swing.mean() == pytest.approx(40.0 * KANG.gain, rel=0.01)
    assert told.pid(2.0).integral == 0.5 * told.ultimate


@pytest.mark.parametrize("noise", ["10 nm"])
def test_noise_of_the_sensor_neither_turns_it_nor_enlarges_the_oscillation(noise: str) -> None:
    """Three times the noise at rest is the least band; the amplitude is that of the first harmonic."""
    relay = Relay("1 kV/s", RATE, "40 V")
    simulate_control(KANG, relay, 0.0, 1.0, rate=RATE, noise=noise, seed=1)
    quiet = Relay("1 kV/s", RATE, "40 V", band=3.0 * to_si(noise, "m", "noise"))
    simulate_control(KANG, quiet, 0.0, 1.0, rate=RATE)
    assert relay.found.frequency == pytest.approx(quiet.found.frequency, rel=0.03)
    assert relay.found.ultimate == pytest.approx(quiet.found.ultimate, rel=0.05)


def test_on_the_rig_it_finds_what_its_chain_adds() -> None:
    """Amplifier, converter, anti-alias filter and the sensor's delay: less gain than the model alone stands,
    by as much as some ticks of delay take."""
    rig = VirtualRig(KANG, load_bench("kang2007-bench"), seed=1)
    relay = Relay("1 kV/s", RATE, "40 V", band="5 nm")
    laser = {"end_effector_position": Channel("interferometer")}
    regulate(rig, relay, 0.0, laser, Limits(max_voltage=100.0), 2.0)
    assert ultimate(10) < relay.found.ultimate < ultimate(0)


def test_what_is_no_relay() -> None:
    relay = Relay(1e3, RATE, 40.0, reach="1 V")
    with pytest.raises(QuantityError, match="not oscillated"):
        _ = relay.found

    def run() -> None:
        for tick in range(5000):
            relay.step(0.0, 0.0, tick)

    with pytest.raises(QuantityError, match="gone 1 V far"):
        run()
