"""A mirror with two inputs and two outputs, simulated by SciPy alone."""

from __future__ import annotations

import numpy as np
from scipy import signal

SAMPLE_RATE = 4000.0
OMEGA = 2 * np.pi * np.array([150.0, 420.0, 700.0])
ZETA = np.array([0.02, 0.05, 0.03])
DELAY = 0.6e-3
# (modes, outputs, inputs), m/V
GAIN = 1e-6 * np.array([[[2.0, -0.5], [0.3, 1.0]], [[-1.0, 0.4], [0.6, -2.0]], [[0.5, 0.5], [-0.5, 0.7]]])
RATE_GAIN = 0.1 * GAIN[:, ::-1]
REMAINDER = 1e-7 * np.array([[1.0, 2.0], [3.0, -1.0]])


def response(frequency: np.ndarray) -> np.ndarray:
    """(frequencies, outputs, inputs), from polynomials by SciPy."""
    found = np.tile(REMAINDER.astype(complex), (len(frequency), 1, 1))
    for w, z, a, b in zip(OMEGA, ZETA, GAIN, RATE_GAIN, strict=True):
        for o in range(2):
            for i in range(2):
                zeros = [b[o, i] * w, a[o, i] * w**2]
                found[:, o, i] += signal.freqs(zeros, [1, 2 * z * w, w**2], 2 * np.pi * frequency)[1]
    return found * np.exp(-2j * np.pi * frequency * DELAY)[:, None, None]


def multisines(rng: np.random.Generator, samples: int, realisations: int, share: float = 0.45) -> np.ndarray:
    """Random phases, all lines up to a share of the sample rate; (samples, 2, realisations), V."""
    spectrum = np.zeros((samples // 2 + 1, 2, realisations), dtype=complex)
    top = int(share * samples)
    spectrum[1:top] = np.exp(2j * np.pi * rng.random((top - 1, 2, realisations)))
    return np.fft.irfft(spectrum, samples, axis=0) * np.sqrt(samples)


def steady(drive: np.ndarray) -> np.ndarray:
    """Steady response to one period of drive (samples, inputs, realisations), as a sum of sinusoids."""
    n = len(drive)
    t, lines = np.arange(n) / SAMPLE_RATE, np.arange(n // 2 + 1)
    frequency = lines * SAMPLE_RATE / n
    amplitude = np.einsum("foi,fir->for", response(frequency), np.fft.fft(drive, axis=0)[: n // 2 + 1])
    wave = np.exp(2j * np.pi * np.outer(t, frequency)) * np.where((lines == 0) | (lines == n // 2), 1, 2)
    return np.real(np.tensordot(wave, amplitude, 1)) / n
