"""Step responses as a sensor would show them, by SciPy's state-space solver."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy import signal

from stickslip.recording import make_recording

TRUTH = {"damping_ratio": 0.524, "natural_frequency": 3303.1, "gain": 0.1057e-6, "delay": 7e-4, "lag": 6e-5}
RATE, START = 20e3, 0.03


def step_recording(
    voltage: float,
    noise: float = 0.0,
    seed: int = 0,
    rise: float = 0.0,
    length: float = 0.08,
    **changed: float,
) -> xr.Dataset:
    """One step: second order, first-order lag, delay; noise [m, rms] behind a filter of 2 kHz."""
    zeta, omega, gain, delay, lag = {**TRUTH, **changed}.values()
    t = np.arange(int(length * RATE)) / RATE
    fine = np.arange(int(length * RATE) * 20) / RATE / 20  # lsim joins the samples of its input by lines
    since = fine - START - delay
    ramp = np.clip(since / rise, 0.0, 1.0) if rise else (since >= 0.0).astype(float)
    den = np.convolve([1 / omega**2, 2 * zeta / omega, 1.0], [lag, 1.0])
    shape = signal.lsim((1.0, den), ramp, fine)[1][::20]
    low = signal.butter(2, 2e3, fs=RATE, output="sos")
    white = np.random.default_rng(seed).standard_normal(t.size + 500)
    coloured = signal.sosfilt(low, white)[500:]
    position = gain * voltage * shape + noise * coloured / coloured.std()
    drive = np.where(t >= START - 1e-9, voltage, 0.0)
    channels = {"drive_voltage": drive, "end_effector_position": position}
    return make_recording(t, channels, title=f"{voltage:g} V")
