"""P4: three friction parameters from a noisy record, from a poor start and from a hundred random ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import xarray as xr

import stickslip as ss

from .. import problems
from ..fits import from_all, judge_fit, judge_starts
from ..worker import Case, serve
from .models import DRIVE, actuator

HOPS = 6  # out of a valley that may be the wrong one: the default
FREE = ("sigma_0", "sigma_1", "coulomb_force")


def _record() -> xr.Dataset:
    times = np.arange(problems.PERIODS * problems.SAMPLES + 1) / 1e3
    return ss.make_recording(times, {"end_effector_position": problems.noisy_record()}, title="P4")


def _fit(record: xr.Dataset, hops: int, start: np.ndarray) -> np.ndarray:
    sigma_0, sigma_1, coulomb = map(float, start)
    model = actuator("P1", sigma_0=sigma_0, sigma_1=sigma_1, coulomb_force=coulomb, stiction_force=coulomb)
    found = ss.identify_friction([record], model=model, free=FREE, drive=DRIVE, hops=hops)
    return np.array([found.values[name] for name in FREE])


def _one(hops: int) -> Callable[[], np.ndarray]:
    return partial(_fit, _record(), hops, np.array(problems.START))


def _many(starts: np.ndarray) -> Callable[[], np.ndarray]:
    record = _record()
    _fit(record, HOPS, np.array(problems.TRUE))
    return lambda: from_all(partial(_fit, record, HOPS), starts)


def cases() -> Iterator[Case]:
    yield Case("stickslip", "ss.identify_friction", "poor start", "P4", partial(_one, HOPS), judge_fit)
    yield Case("stickslip", "the same, hops=0", "poor start", "P4", partial(_one, 0), judge_fit)
    make = partial(_many, problems.random_starts(100))
    yield Case("stickslip", "ss.identify_friction", "100 random starts", "P4", make, judge_starts, once=True)


if __name__ == "__main__":
    serve({"fit": cases}, ["stickslip", "numba", "scipy"])
