"""Steady stepping, solved for; and by this package's own simulation, waited for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

import stickslip as ss

from .. import problems
from ..worker import Case, serve
from .models import actuator

TOLERANCE = 1e-10  # m


def _model(problem: str) -> tuple[ss.Actuator, ss.Sawtooth]:
    p = problems.STEADY[problem]
    return actuator("P1").replace(natural_frequency=p.natural_frequency), ss.Sawtooth(
        p.amplitude, p.frequency
    )


def _solved(problem: str) -> Callable[[], float]:
    model, drive = _model(problem)
    return lambda: ss.steady_step(model, drive, tolerance=TOLERANCE)


def _waited(problem: str) -> Callable[[], float]:
    """The last of as many periods as it takes, as if that number were known."""
    model, drive = _model(problem)
    periods = problems.STEADY[problem].periods
    times = np.array([0, periods - 1, periods]) / drive.frequency

    def run() -> float:
        x = ss.simulate(model, drive, times=times, tolerance=TOLERANCE)["end_effector_position"].values
        return float(x[-1] - x[-2])

    return run


def cases() -> Iterator[Case]:
    for problem, p in problems.STEADY.items():
        judge = partial(problems.step_error, problem)
        make = partial(_solved, problem)
        yield Case("stickslip", "ss.steady_step", f"{TOLERANCE:g} m", problem, make, judge)
        setting = f"{TOLERANCE:g} m, {p.periods} periods"
        yield Case("stickslip", "ss.simulate", setting, problem, partial(_waited, problem), judge)


if __name__ == "__main__":
    serve({"steady": cases}, ["stickslip", "numba", "numpy"])
