"""CasADi: CVODES with symbolic derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import casadi as ca
import numpy as np

from .. import problems
from ..problems import DAMPING, DRIVE, SLOPE, STIFFNESS, TAU
from ..worker import Case, serve
from .periods import restarted


def simulator(problem: str, method: str, tolerance: float) -> Callable[[], np.ndarray]:
    p = problems.PROBLEMS[problem]
    scale = np.array(p.scale)  # the states are scaled: its absolute tolerance is one number
    q, t = ca.SX.sym("q", 5), ca.SX.sym("t")
    y, w, z, _, s = ca.vertsplit(q * ca.DM(scale))
    v = w - s
    g = p.coulomb_force
    if p.stiction_force != p.coulomb_force:
        g = g + (p.stiction_force - p.coulomb_force) * ca.exp(-((v / p.stribeck_velocity) ** 2))
    dz = v - p.sigma_0 * ca.fabs(v) / g * z
    force = p.sigma_0 * z + p.sigma_1 * dz
    rates = ca.vertcat(w, DRIVE * SLOPE * t - DAMPING * w - STIFFNESS * y, dz, s, force / p.mass)
    options = {
        "reltol": tolerance,
        "abstol": tolerance,
        "max_num_steps": 10_000_000,
        "linear_multistep_method": method.lower(),
    }
    ode = {"x": q, "t": t, "ode": rates / ca.DM(scale)}
    integrator = ca.integrator("period", "cvodes", ode, 0.0, TAU[1:], options)

    def one_period(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        states = integrator(x0=state)["xf"].full()
        return states[3] * scale[3], states[:, -1]

    return restarted(one_period)


def trajectory() -> Iterator[Case]:
    for problem, methods in (("P1", ("Adams", "BDF")), ("P2", ("BDF",))):
        for method in methods:
            for tolerance in (1e-5, 1e-7):
                yield Case(
                    "CasADi CVODES",
                    method,
                    f"rtol {tolerance:g}",
                    problem,
                    partial(simulator, problem, method, tolerance),
                    partial(problems.error, problem),
                )


if __name__ == "__main__":
    serve({"trajectory": trajectory}, ["casadi"])
