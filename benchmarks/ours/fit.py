"""P4: three friction parameters from a noisy record, from a poor start and from a hundred random ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import xarray as xr

import stickslip as ss

from .. import problems
from ..fits import judge_fit, judge_starts
from ..worker import Case, serve
from .models import DRIVE, actuator

FREE = ("sigma_0", "sigma_1", "coulomb_force")


def _record() -> xr.Dataset:
    times = np.arange(problems.PERIODS * problems.SAMPLES + 1) / 1e3
    return ss.make_recording(times, {"end_effector_position": problems.noisy_record()}, title="P4")


def _fit(record: xr.Dataset, start: np.ndarray) -> np.ndarray:
    sigma_0, sigma_1, coulomb = map(float, start)
    model = actuator("P1", sigma_0=sigma_0, sigma_1=sigma_1, coulomb_force=coulomb, stiction_force=coulomb)
    found = ss.identify_friction([record], model=model, free=FREE, drive=DRIVE)
    return np.array([found.values[name] for name in FREE])


def _one(start: np.ndarray) -> Callable[[], np.ndarray]:
    return partial(_fit, _record(), start)


def _many(starts: np.ndarray) -> Callable[[], np.ndarray]:
    record = _record()
    _fit(record, np.array(problems.TRUE))
    return lambda: np.array([_fit(record, start) for start in starts])


def cases() -> Iterator[Case]:
    make = partial(_one, np.array(problems.START))
    yield Case("stickslip", "ss.identify_friction", "poor start", "P4", make, judge_fit)
    make = partial(_many, problems.random_starts(100))
    yield Case("stickslip", "ss.identify_friction", "100 random starts", "P4", make, judge_starts, once=True)


if __name__ == "__main__":
    serve({"fit": cases}, ["stickslip", "numba", "scipy"])
