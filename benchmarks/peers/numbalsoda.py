"""numbalsoda: ODEPACK's LSODA and Hairer's DOP853, compiled, called from compiled code. The best peer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numba
import numpy as np
from numbalsoda import dop853, lsoda, lsoda_sig

from .. import problems
from ..problems import PERIOD, PERIODS, SAMPLES, TAU
from ..truth import judge_members
from ..worker import Case, serve
from .equations import contact_of, rates

SOLVERS = {"DOP853": dop853, "LSODA": lsoda}


def scaled(problem: str) -> Any:
    """The right-hand side as a C function of the states over their sizes, for all share one tolerance; its
    parameters are sigma_0, sigma_1, F_C and the mass."""
    c0, c1, c2, c3, c4 = problems.PROBLEMS[problem].scale
    _, _, coulomb, stiction, stribeck, _ = contact_of(problem)
    excess = stiction - coulomb

    @numba.cfunc(lsoda_sig)
    def f(t, q, out, p):
        contact = (p[0], p[1], p[2], p[2] + excess, stribeck, p[3])
        a, b, c, d, e = rates(t, q[0] * c0, q[1] * c1, q[2] * c2, q[4] * c4, contact)
        out[0], out[1], out[2], out[3], out[4] = a / c0, b / c1, c / c2, d / c3, e / c4

    return f


def parameters(problem: str) -> np.ndarray:
    p = problems.PROBLEMS[problem]
    return np.array([p.sigma_0, p.sigma_1, p.coulomb_force, p.mass])


def simulator(problem: str, method: str) -> Callable[[np.ndarray, float], np.ndarray]:
    """The positions from the parameters and the relative tolerance."""
    f, solver, size = scaled(problem), SOLVERS[method], problems.PROBLEMS[problem].scale[3]
    address = f.address

    @numba.njit
    def simulate(p, tolerance):
        q, found = np.zeros(5), np.zeros(PERIODS * SAMPLES + 1)
        for k in range(PERIODS):
            states, _ = solver(address, q, TAU, p, rtol=tolerance, atol=tolerance, mxstep=1_000_000)
            found[k * SAMPLES + 1 : (k + 1) * SAMPLES + 1] = states[1:, 3] * size
            q = states[-1].copy()
        return found

    def run(p: np.ndarray, tolerance: float) -> np.ndarray:
        assert f  # kept: the address is of this function
        return simulate(p, tolerance)

    return run


def trajectory() -> Iterator[Case]:
    for problem in problems.PROBLEMS:
        for method in SOLVERS:
            simulate = simulator(problem, method)
            for tolerance in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9):
                yield Case(
                    "numbalsoda",
                    method,
                    f"rtol {tolerance:g}",
                    problem,
                    partial(partial, simulate, parameters(problem), tolerance),
                    partial(problems.error, problem),
                )


def ensemble_of(method: str) -> Callable[[np.ndarray, float], np.ndarray]:
    """Net displacement of each parameter set of P3, on all cores."""
    f, solver, size = scaled("P1"), SOLVERS[method], problems.PROBLEMS["P1"].scale[3]
    address, ends, sigma_1 = f.address, np.array([0.0, PERIOD]), problems.PROBLEMS["P1"].sigma_1

    @numba.njit(parallel=True)
    def simulate(sets, tolerance):
        net = np.empty(len(sets))
        for m in numba.prange(len(sets)):
            p = np.array([sets[m, 0], sigma_1, sets[m, 1], sets[m, 2]])
            q = np.zeros(5)
            for _ in range(PERIODS):
                states, ok = solver(address, q, ends, p, rtol=tolerance, atol=tolerance, mxstep=1_000_000)
                q = states[-1].copy()
                if not ok:
                    q[3] = np.nan
            net[m] = q[3] * size
        return net

    def run(sets: np.ndarray, tolerance: float) -> np.ndarray:
        assert f  # kept: the address is of this function
        return simulate(sets, tolerance)

    return run


def members() -> Iterator[Case]:
    simulate, sets = ensemble_of("DOP853"), problems.parameter_sets()
    for tolerance in (1e-3, 1e-4, 1e-5):
        make = partial(partial, simulate, sets, tolerance)
        yield Case("numbalsoda, prange", "DOP853", f"rtol {tolerance:g}", "P3", make, judge_members)


def stepper(method: str) -> Callable[..., np.ndarray]:
    """Net step of each of a number of periods of P1's contact under another stage and drive."""
    c0, c1, c2, c3, c4 = problems.PROBLEMS["P1"].scale
    contact, solver = contact_of("P1"), SOLVERS[method]

    @numba.cfunc(lsoda_sig)
    def f(t, q, out, p):
        y, w, z, s = q[0] * c0, q[1] * c1, q[2] * c2, q[4] * c4
        _, _, dz, _, ds = rates(t, y, w, z, s, contact)
        dw = p[0] * p[0] * (problems.GAIN * p[1] * t - y) - 2.0 * problems.ZETA * p[0] * w
        out[0], out[1], out[2], out[3], out[4] = w / c0, dw / c1, dz / c2, s / c3, ds / c4

    address = f.address

    @numba.njit
    def simulate(frequency, slope, period, periods, tolerance):
        p, ends = np.array([frequency, slope]), np.array([0.0, period])
        q, steps = np.zeros(5), np.empty(periods)
        for k in range(periods):
            q[3] = 0.0
            states, _ = solver(address, q, ends, p, rtol=tolerance, atol=tolerance, mxstep=1_000_000)
            q = states[-1].copy()
            steps[k] = q[3] * c3
        return steps

    def run(problem: str, periods: int, tolerance: float) -> np.ndarray:
        assert f  # kept: the address is of this function
        p = problems.STEADY[problem]
        slope = p.amplitude * p.frequency
        return simulate(p.natural_frequency, slope, 1.0 / p.frequency, periods, tolerance)

    return run


def steady() -> Iterator[Case]:
    steps = stepper("DOP853")
    for problem, p in problems.STEADY.items():
        for tolerance in (1e-3, 1e-4, 1e-5, 1e-6):
            yield Case(
                "numbalsoda",
                "DOP853",
                f"rtol {tolerance:g}, {p.periods} periods",
                problem,
                partial(partial, steps, problem, p.periods, tolerance),
                lambda found, problem=problem: problems.step_error(problem, float(found[-1])),
            )


PARTS = {"trajectory": trajectory, "ensemble": members, "steady": steady}

if __name__ == "__main__":
    serve(PARTS, ["numbalsoda", "numba"])
