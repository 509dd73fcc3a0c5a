"""One trajectory, 1601 samples: the compiled engine by itself, and the public call around it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import stickslip as ss
from stickslip.engine.binding import ComposedPlant, DriveTable, integrate
from stickslip.simulation.models import RelativeLoad

from .. import problems
from ..worker import Case, serve
from .models import DRIVE, DURATION, UNLIKE, actuator

TOLERANCES = (1e-7, 3e-8, 1e-8, 3e-9, 1e-9, 1e-10, 1e-11)
PUBLIC = (1e-8, 1e-9, 1e-10)
MAX_STEPS = 1_000_000


def _engine(problem: str, drive: Any, tolerance: float) -> Callable[[], np.ndarray]:
    contact = RelativeLoad()
    of, table = contact.system(actuator(problem)), drive.drive(DURATION)
    times = np.arange(problems.PERIODS * problems.SAMPLES + 1) / 1e3
    start = contact.rest(of, 0.0)
    samples, span = np.empty((times.size, start.size + 1)), (0.0, DURATION)
    made = ComposedPlant(of.plant), DriveTable(table), DriveTable(contact.drive)

    def run() -> np.ndarray:
        q = start.copy()
        integrate(*made, q, span, tolerance, False, MAX_STEPS, times, samples)
        return samples[:, of.slider]

    return run


def _public(problem: str, tolerance: float) -> Callable[[], np.ndarray]:
    model = actuator(problem)
    return lambda: ss.simulate(model, DRIVE, DURATION, tolerance=tolerance)["end_effector_position"].values


def cases() -> Iterator[Case]:
    for problem in problems.PROBLEMS:
        judge = partial(problems.error, problem)
        for name, drive in (("engine", DRIVE), ("engine, no period repeats", UNLIKE)):
            for tolerance in TOLERANCES:
                make = partial(_engine, problem, drive, tolerance)
                yield Case("stickslip", name, f"{tolerance:g} m", problem, make, judge)
        for tolerance in PUBLIC:
            make = partial(_public, problem, tolerance)
            yield Case("stickslip", "ss.simulate", f"{tolerance:g} m", problem, make, judge)


if __name__ == "__main__":
    serve({"trajectory": cases}, ["stickslip", "numba", "numpy"])
