"""P4 the way it is fitted today: least squares of SciPy or lmfit over the best simulators for it.

Logarithms of the parameters, forward differences of 1e-4, residuals over the noise; bounds a factor 30 either
side of the start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import lmfit
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from .. import problems
from ..fits import from_all, judge_fit, judge_starts
from ..problems import NOISE, PERIOD, TAU
from ..worker import Case, serve
from .equations import with_contact
from .numbalsoda import simulator
from .periods import restarted

REACH = np.log(30.0)
TOLERANCE = 1e-8  # of the simulations: differences of 1e-4 need it

Simulate = Callable[[np.ndarray], np.ndarray]


def with_dop853() -> Simulate:
    run, mass = simulator("P1", "DOP853"), problems.PROBLEMS["P1"].mass
    return lambda values: run(np.append(values, mass), TOLERANCE)


def with_scipy() -> Simulate:
    """LSODA of solve_ivp with a compiled right-hand side."""
    f = with_contact()
    p = problems.PROBLEMS["P1"]
    absolute = TOLERANCE * np.array(p.scale)

    def simulate(values: np.ndarray) -> np.ndarray:
        sigma_0, sigma_1, coulomb = map(float, values)
        contact = (sigma_0, sigma_1, coulomb, coulomb, p.stribeck_velocity, p.mass)

        def one_period(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            found = solve_ivp(
                f, (0.0, PERIOD), state, "LSODA", TAU, args=(contact,), rtol=TOLERANCE, atol=absolute
            )
            return found.y[3, 1:], found.y[:, -1].copy()

        return restarted(one_period)()

    return simulate


def with_trf(simulate: Simulate, record: np.ndarray, start: np.ndarray) -> np.ndarray:
    def residuals(logs: np.ndarray) -> np.ndarray:
        return (simulate(np.exp(logs)) - record) / NOISE

    logs = np.log(start)
    found = least_squares(
        residuals,
        logs,
        bounds=(logs - REACH, logs + REACH),
        diff_step=1e-4,
        xtol=1e-9,
        ftol=1e-9,
        gtol=1e-9,
        max_nfev=200,
    )
    return np.exp(found.x)


def with_lmfit(simulate: Simulate, record: np.ndarray, start: np.ndarray) -> np.ndarray:
    parameters = lmfit.Parameters()
    for name, value in zip("abc", np.log(start), strict=True):
        parameters.add(name, value=value, min=value - REACH, max=value + REACH)

    def residuals(found: Any) -> np.ndarray:
        return (simulate(np.exp([found[name].value for name in "abc"])) - record) / NOISE

    result = lmfit.minimize(residuals, parameters, method="leastsq", epsfcn=1e-8, ftol=1e-9, xtol=1e-9)
    return np.exp([result.params[name].value for name in "abc"])


def _one(fit: Callable[..., np.ndarray], simulator: Callable[[], Simulate]) -> Callable[[], np.ndarray]:
    simulate, record = simulator(), problems.noisy_record()
    simulate(np.array(problems.TRUE))
    return partial(fit, simulate, record, np.array(problems.START))


def _many(starts: np.ndarray) -> Callable[[], np.ndarray]:
    simulate, record = with_dop853(), problems.noisy_record()
    simulate(np.array(problems.TRUE))
    return lambda: from_all(partial(with_trf, simulate, record), starts)


def cases() -> Iterator[Case]:
    for name, fit in (("scipy trf", with_trf), ("lmfit leastsq", with_lmfit)):
        for method, simulate in (("numbalsoda DOP853", with_dop853), ("scipy LSODA", with_scipy)):
            if fit is with_lmfit and simulate is with_dop853:
                continue  # its many tiny steps take minutes
            once = simulate is with_scipy
            yield Case(name, method, "poor start", "P4", partial(_one, fit, simulate), judge_fit, once)
    make = partial(_many, problems.random_starts(100))
    yield Case("scipy trf", "numbalsoda DOP853", "100 random starts", "P4", make, judge_starts, once=True)


if __name__ == "__main__":
    serve({"fit": cases}, ["scipy", "lmfit", "numbalsoda", "numba"])
