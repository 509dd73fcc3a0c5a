"""P3 in one call; and, in a fresh process each, how time and memory grow with the members."""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

import stickslip as ss

from .. import problems
from ..truth import judge_members
from ..worker import Case, serve
from .models import DRIVE, DURATION, actuator

TOLERANCES = (1e-7, 3e-8, 1e-8, 3e-9, 1e-9)
MEMBERS = (1_000, 10_000, 100_000, 1_000_000)


def ensemble(members: int, tolerance: float, engine: Any = "cpu") -> Callable[[], np.ndarray]:
    """P3 by an engine."""
    model, sets = actuator("P1"), problems.parameter_sets(members)
    names: tuple[str, ...] = ("sigma_0", "coulomb_force", "end_effector_mass")
    columns: dict[str, np.ndarray] = dict(zip(names, sets.T, strict=True))

    def run() -> np.ndarray:
        found = ss.simulate_ensemble(
            model, DRIVE, DURATION, parameters=columns, tolerance=tolerance, engine=engine
        )
        return found["net_displacement"].values

    return run


def _members() -> Iterator[Case]:
    for tolerance in TOLERANCES:
        make = partial(ensemble, problems.MEMBERS, tolerance)
        yield Case("stickslip", "ss.simulate_ensemble", f"{tolerance:g} m", "P3", make, judge_members)


def _memory(net: np.ndarray) -> dict[str, float]:
    """The most this process ever held, in bytes."""
    if not np.all(np.isfinite(net)):
        raise ArithmeticError("a member failed")
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "members": net.size,
        "peak_memory_bytes": unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    }


def _growth(members: int) -> list[Case]:
    make = partial(ensemble, members, 1e-8)
    return [
        Case("stickslip", "ss.simulate_ensemble", f"{members} members", "P3", make, _memory, members > 10_000)
    ]


if __name__ == "__main__":
    growth = {f"ensemble-{n}": partial(_growth, n) for n in MEMBERS}
    serve({"ensemble": _members, **growth}, ["stickslip", "numba", "numpy"])
