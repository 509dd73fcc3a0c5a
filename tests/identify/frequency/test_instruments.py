"""What instruments do, against SciPy's simulation of them and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from stickslip.identify.frequency.instruments import applied_voltage, without_filter
from stickslip.identify.frequency.response import frequency_response
from stickslip.physics.electronics import Amplifier, Filter

RATE = 20e3
AMPLIFIER = Amplifier(
    gain=16.0, offset=0.3, bandwidth=3e3, slew_rate=1e12, max_current=1e6, low=-10.0, high=150.0
)


def test_a_held_command_passes_hold_and_bandwidth() -> None:
    """Of each sine: sinc and half a sample of the hold, times the amplifier's pole; the rest is above."""
    n, lines = 2000, np.array([3, 40, 250, 600, 780])
    t = np.arange(3 * n) / RATE
    frequency = lines * RATE / n
    command = 50.0 + np.sum(np.sin(2 * np.pi * np.outer(t, frequency) + lines), axis=1)
    found = applied_voltage(command, RATE, AMPLIFIER, 1.4e-6)
    response = frequency_response(command[n : 2 * n], found[n : 2 * n], RATE).squeeze()
    np.testing.assert_allclose(response["frequency"], frequency)
    hold = np.sinc(frequency / RATE) * np.exp(-1j * np.pi * frequency / RATE)
    np.testing.assert_allclose(response["response"], hold / (1 + 1j * frequency / 3e3), atol=7e-4)


def test_the_current_limit_makes_a_jump_a_ramp() -> None:
    command = np.repeat([10.0, 60.0], 200)
    limited = AMPLIFIER._replace(bandwidth=1e6, max_current=0.014)  # 1e4 V/s: 5 ms for 50 V
    found = applied_voltage(command, RATE, limited, 1.4e-6)
    ramp = np.clip(10.0 + 1e4 * (np.arange(400) / RATE - 0.01), 10.0, 60.0)
    np.testing.assert_allclose(found[:395], ramp[:395], atol=0.07)  # corners are rounded
    np.testing.assert_allclose(found[[0, -1]], [10.0, 60.0], atol=1e-3)


@pytest.mark.parametrize("low_pass", [Filter(1, 500.0), Filter(4, 3e3, "bessel")])
def test_a_filter_is_divided_out(low_pass: Filter) -> None:
    """What SciPy's filter did to a response, line by line; the deviations keep their share."""
    n = 1000
    drive = np.random.default_rng(0).standard_normal(n)
    made = np.fft.rfftfreq(n, 1 / RATE)
    system = 3e-7 / (1 + 1j * made / 700.0)
    kinds = {"butterworth": signal.butter, "bessel": signal.bessel}
    options = {"norm": "mag"} if low_pass.family == "bessel" else {}
    b, a = kinds[low_pass.family](int(low_pass.order), low_pass.corner, fs=RATE, **options)
    passed = np.polyval(b[::-1], z := np.exp(-2j * np.pi * made / RATE)) / np.polyval(a[::-1], z)
    seen = np.fft.irfft(np.fft.rfft(drive) * system * passed, n)
    noise = 1e-9 * np.random.default_rng(1).standard_normal((n, 1, 1, 3))
    response = frequency_response(
        np.tile(drive[:, None, None, None], 3), seen[:, None, None, None] + noise, RATE, band=(0.0, 5e3)
    )
    freed = without_filter(response, low_pass, RATE)
    at = response["frequency"].to_numpy()
    errors = freed["response"].values[:, 0, 0] - 3e-7 / (1 + 1j * at / 700.0)
    assert np.sqrt(np.mean(np.abs(errors / freed["deviation"].values[:, 0, 0]) ** 2)) < 1.5
    share = [r["deviation"] / abs(r["response"]) for r in (response, freed)]
    np.testing.assert_allclose(*share, rtol=1e-12)
    assert freed["response"].attrs["units"] == "m/V"
    assert freed["coherence"].equals(response["coherence"])
