"""scikit-sundae: CVODE of SUNDIALS, with a compiled right-hand side and Jacobian."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from sksundae.cvode import CVODE

from .. import problems
from ..worker import Case, serve
from .equations import in_place, jacobian
from .periods import restarted


def simulator(problem: str, method: str, tolerance: float) -> Callable[[], np.ndarray]:
    matrix = jacobian(problem)

    def fill(t: float, q: np.ndarray, _: np.ndarray, out: np.ndarray) -> None:
        out[:, :] = matrix(t, np.array(q))

    solver = CVODE(
        in_place(problem),
        method=method,
        rtol=tolerance,
        atol=tolerance * np.array(problems.PROBLEMS[problem].scale),
        max_num_steps=1_000_000,
        jacfn=fill if method == "BDF" else None,
    )

    def one_period(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = solver.solve(problems.TAU, state)
        if not found.success:
            raise ArithmeticError(found.message)
        return found.y[1:, 3], found.y[-1].copy()

    return restarted(one_period)


def trajectory() -> Iterator[Case]:
    for problem, methods in (("P1", ("Adams", "BDF")), ("P2", ("BDF",))):
        for method in methods:
            for tolerance in (1e-5, 1e-7):
                yield Case(
                    "scikit-sundae CVODE",
                    method,
                    f"rtol {tolerance:g}",
                    problem,
                    partial(simulator, problem, method, tolerance),
                    partial(problems.error, problem),
                )


if __name__ == "__main__":
    serve({"trajectory": trajectory}, ["scikit-sundae", "numba"])
