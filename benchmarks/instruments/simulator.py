"""Recordings by a simulator of its own in C (`walk.c`), which shares no code with the package."""

from __future__ import annotations

import ctypes
import hashlib
import subprocess
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

STEP, EVERY = 0.5e-6, 4  # integration step, s; steps between stored positions
SLEW = 286e3  # V/s


class Truth(NamedTuple):
    """An actuator, SI; the fields and their order are those of `struct plant` in walk.c."""

    gain: float
    natural_frequency: float
    damping_ratio: float
    stage_mass: float
    end_effector_mass: float
    sigma_0: float
    sigma_1: float
    sigma_2: float
    coulomb_force: float
    stiction_force: float
    stribeck_velocity: float
    asymmetry: float = 0.0
    unevenness: float = 0.0
    length: float = 5e-6
    reaction: float = 0.0
    clamped: float = 0.0


class Motion(NamedTuple):
    """True position [m] of the slider and voltage [V] at the piezo, stored every `STEP * EVERY` seconds."""

    position: np.ndarray
    times: np.ndarray
    volts: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """Return positions at any instants, by straight lines between stored ones (error below 0.1 nm)."""
        return np.interp(t, np.arange(self.position.size) * STEP * EVERY, self.position)

    def voltage(self, t: np.ndarray) -> np.ndarray:
        """Return the voltage at any instants."""
        return np.interp(t, self.times, self.volts)


def sawtooth(volts: float, frequency: float, periods: int, rest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (s, V) of a sawtooth after a rest, its falls as slow as the amplifier's slew rate."""
    slope = volts * frequency
    fall = volts / (SLEW + slope)  # from the jump until the output meets the next rise
    times, levels = [0.0, rest], [0.0, 0.0]
    for k in range(1, periods + 1):
        at, last = rest + k / frequency, k == periods
        times += [at, at + (volts / SLEW if last else fall)]
        levels += [volts, 0.0 if last else fall * slope]
    return np.array([*times, times[-1] + 10.0]), np.array([*levels, 0.0])


def step(volts: float, rest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (s, V) of a step after a rest, as slow as the amplifier's slew rate."""
    return np.array([0.0, rest, rest + volts / SLEW, rest + 10.0]), np.array([0.0, 0.0, volts, volts])


def motion(truth: Truth, drive: tuple[np.ndarray, np.ndarray], duration: float) -> Motion:
    """Return the motion of an actuator from rest over `duration` seconds."""
    count = int(np.ceil(duration / (STEP * EVERY))) + 2
    position = np.empty(count)
    times, volts = (np.ascontiguousarray(x, dtype=float) for x in drive)
    _library().walk(
        (ctypes.c_double * len(truth))(*truth), _pointer(times), _pointer(volts), ctypes.c_long(times.size),
        ctypes.c_double(STEP), ctypes.c_long(EVERY), ctypes.c_long(count), _pointer(position),
    )  # fmt: skip
    return Motion(position, times, volts)


def _pointer(array: np.ndarray) -> ctypes._Pointer[ctypes.c_double]:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@cache
def _library() -> ctypes.CDLL:
    source = Path(__file__).with_name("walk.c")
    folder = Path(tempfile.mkdtemp(prefix="walk-"))
    made = folder / f"walk-{hashlib.sha256(source.read_bytes()).hexdigest()[:12]}.so"
    command: Sequence[str] = ["cc", "-O2", "-shared", "-fPIC", "-o", str(made), str(source), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(made))
