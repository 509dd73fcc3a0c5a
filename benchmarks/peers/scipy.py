"""SciPy: odeint and solve_ivp, with a compiled right-hand side and Jacobian."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.integrate import odeint, solve_ivp

from .. import problems
from ..problems import PERIOD, TAU
from ..worker import Case, serve
from .equations import allocating, jacobian
from .periods import restarted


def with_odeint(problem: str, tolerance: float) -> Callable[[], np.ndarray]:
    f, matrix = allocating(problem), jacobian(problem)
    absolute = tolerance * np.array(problems.PROBLEMS[problem].scale)

    def one_period(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        states = odeint(
            f, state, TAU, rtol=tolerance, atol=absolute, Dfun=matrix, tfirst=True, mxstep=1_000_000
        )
        return states[1:, 3], states[-1].copy()

    return restarted(one_period)


def with_solve_ivp(problem: str, method: str, tolerance: float) -> Callable[[], np.ndarray]:
    f = allocating(problem)
    options = {"jac": jacobian(problem)} if method in ("LSODA", "Radau") else {}
    absolute = tolerance * np.array(problems.PROBLEMS[problem].scale)

    def one_period(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = solve_ivp(f, (0.0, PERIOD), state, method, TAU, rtol=tolerance, atol=absolute, **options)
        if not found.success:
            raise ArithmeticError(found.message)
        return found.y[3, 1:], found.y[:, -1].copy()

    return restarted(one_period)


def trajectory() -> Iterator[Case]:
    for problem in problems.PROBLEMS:
        judge = partial(problems.error, problem)
        for tolerance in (1e-4, 1e-5, 1e-7):
            make = partial(with_odeint, problem, tolerance)
            yield Case("scipy odeint", "LSODA", f"rtol {tolerance:g}", problem, make, judge)
        for method in ("LSODA", "DOP853", "Radau") if problem == "P1" else ("LSODA",):
            make = partial(with_solve_ivp, problem, method, 1e-5)
            yield Case("scipy solve_ivp", method, "rtol 1e-05", problem, make, judge)


if __name__ == "__main__":
    serve({"trajectory": trajectory}, ["scipy", "numba"])
