"""The campaign's friction fit by lmfit over SciPy's LSODA, and by SciPy's trf over numbalsoda's DOP853."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import lmfit
import numba
import numpy as np
from numbalsoda import dop853, lsoda_sig
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from .. import campaign, problems
from ..worker import Case, serve

TOLERANCE = 1e-8  # of the simulations: differences of 1e-4 need it
REACH = np.log(30.0)
NOISE = 0.13e-6
# s of CPU time: who has not ended by then is stopped, and has taken at least so long.
LIMITS = {"scipy trf": 30.0, "lmfit leastsq": 150.0}
C0, C1, C2, C3, C4 = problems.PROBLEMS["P1"].scale

Simulate = Callable[[np.ndarray, float], np.ndarray]


@numba.njit(inline="always")
def _rates(t, q, p, out):
    """Of the states over their sizes; p: sigma_0, sigma_1, F_C, mass, gain, wn, zeta, u and its slope."""
    y, w, z, s = q[0] * C0, q[1] * C1, q[2] * C2, q[4] * C4
    v = w - s
    dz = v - p[0] * abs(v) / p[2] * z
    dw = p[5] * p[5] * (p[4] * (p[7] + p[8] * t) - y) - 2.0 * p[6] * p[5] * w
    out[0], out[1], out[2], out[3] = w / C0, dw / C1, dz / C2, s / C3
    out[4] = (p[0] * z + p[1] * dz) / p[3] / C4


def _pieces(walk: campaign.Walk, delay: float) -> Iterator[tuple[int, np.ndarray, int, int]]:
    """Of each piece of the drive: its number, times from its start (start, samples, end), which samples."""
    times = walk.time - delay
    ends = np.append(walk.start[1:], max(times[-1], walk.start[-1]) + 1e-6)
    for i, (begin, end) in enumerate(zip(walk.start, ends, strict=True)):
        first, last = np.searchsorted(times, [begin, end])
        inside = times[first:last]
        inside = inside[(inside > begin) & (inside < end)]
        first = last - inside.size
        yield i, np.concatenate([[0.0], inside - begin, [end - begin]]), first, last


def _parameters(walk: campaign.Walk, values: np.ndarray, i: int) -> np.ndarray:
    return np.array([*values[:3], campaign.MASS, *walk.stage, walk.level[i], walk.slope[i]])


def with_dop853(walk: campaign.Walk) -> Simulate:
    @numba.cfunc(lsoda_sig)
    def f(t, q, out, p):
        _rates(t, q, p, out)

    address = f.address

    @numba.njit
    def piece(q, taus, p, tolerance):
        states, _ = dop853(address, q, taus, p, rtol=tolerance, atol=tolerance, mxstep=1_000_000)
        return states

    def simulate(values: np.ndarray, delay: float) -> np.ndarray:
        assert f  # kept: the address is of this function
        q, found = np.zeros(5), np.zeros(walk.time.size)
        for i, taus, first, last in _pieces(walk, delay):
            states = piece(q, taus, _parameters(walk, values, i), TOLERANCE)
            found[first:last] = states[1:-1, 3] * C3
            q = states[-1].copy()
        return found

    return simulate


def with_scipy(walk: campaign.Walk) -> Simulate:
    """LSODA of solve_ivp with a compiled right-hand side."""

    @numba.njit
    def f(t, q, p):
        out = np.empty(5)
        _rates(t, q, p, out)
        return out

    def simulate(values: np.ndarray, delay: float) -> np.ndarray:
        q, found = np.zeros(5), np.zeros(walk.time.size)
        for i, taus, first, last in _pieces(walk, delay):
            p = _parameters(walk, values, i)
            span = (0.0, taus[-1])
            done = solve_ivp(f, span, q, "LSODA", taus, args=(p,), rtol=TOLERANCE, atol=TOLERANCE)
            found[first:last] = done.y[3, 1:-1] * C3
            q = done.y[:, -1].copy()
        return found

    return simulate


class Objective:
    """Residuals of three logarithms, the delay in ms and the offset in um; TimeoutError when time is over."""

    def __init__(self, walk: campaign.Walk, simulate: Simulate, limit: float) -> None:
        self.walk, self.simulate = walk, simulate
        self.end = time.process_time() + limit
        self.evaluations, self.lowest, self.best = 0, np.inf, _coordinates(campaign.start())

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if time.process_time() > self.end:
            raise TimeoutError
        self.evaluations += 1
        r = (self.simulate(np.exp(x[:3]), 1e-3 * x[3]) + 1e-6 * x[4] - self.walk.position) / NOISE
        if float(r @ r) < self.lowest:
            self.lowest, self.best = float(r @ r), np.array(x)
        return r


def _coordinates(values: np.ndarray) -> np.ndarray:
    return np.array([*np.log(values[:3]), 1e3 * values[3], 1e6 * values[4]])


def _values(x: np.ndarray) -> np.ndarray:
    return np.array([*np.exp(x[:3]), 1e-3 * x[3], 1e-6 * x[4]])


def _bounds(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    low = np.array([*(x[:3] - REACH), -1e3 * campaign.LONGEST_DELAY, -1e6 * campaign.LARGEST_OFFSET])
    high = np.array([*(x[:3] + REACH), 1e3 * campaign.LONGEST_DELAY, 1e6 * campaign.LARGEST_OFFSET])
    return low, high


def with_trf(objective: Objective, end: float = 1e-9) -> None:
    """`end`: relative change at which it ends; ours ends a hundredth of a standard error off its own end, for
    which this problem needs 1e-7."""
    x = _coordinates(campaign.start())
    least_squares(
        objective,
        x,
        bounds=_bounds(x),
        diff_step=1e-4,
        xtol=end,
        ftol=end,
        gtol=end,
        max_nfev=200,
    )


def with_lmfit(objective: Objective) -> None:
    x = _coordinates(campaign.start())
    parameters = lmfit.Parameters()
    for name, value, low, high in zip("abcde", x, *_bounds(x), strict=True):
        parameters.add(name, value=value, min=low, max=high)

    def residuals(found: Any) -> np.ndarray:
        return objective(np.array([found[name].value for name in "abcde"]))

    lmfit.minimize(residuals, parameters, method="leastsq", epsfcn=1e-8, ftol=1e-9, xtol=1e-9)


def _one(
    fit: Callable[[Objective], None], simulator: Callable[[campaign.Walk], Simulate], limit: float
) -> Callable[[], campaign.Fitted]:
    walk = campaign.load()
    simulate = simulator(walk)
    simulate(np.array(problems.TRUE), 1e-3)

    def run() -> campaign.Fitted:
        objective, ended = Objective(walk, simulate, limit), True
        try:
            fit(objective)
        except TimeoutError:
            ended = False
        rms = NOISE * float(np.sqrt(objective.lowest / walk.position.size))
        return campaign.Fitted(_values(objective.best), objective.evaluations, ended, rms)

    return run


def cases() -> Iterator[Case]:
    for tool, fit, method, simulator in (
        ("scipy trf", with_trf, "numbalsoda DOP853", with_dop853),
        ("scipy trf", partial(with_trf, end=1e-7), "numbalsoda DOP853, ended at 1e-7", with_dop853),
        ("lmfit leastsq", with_lmfit, "scipy LSODA", with_scipy),
    ):
        make = partial(_one, fit, simulator, LIMITS[tool])
        yield Case(tool, method, "the thesis's start", "campaign", make, campaign.judge, once=True)


if __name__ == "__main__":
    serve({"campaign": cases}, ["scipy", "lmfit", "numbalsoda", "numba"])
