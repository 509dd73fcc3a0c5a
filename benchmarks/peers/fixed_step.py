"""The classical Runge-Kutta method at a fixed step, by hand in Numba: the thesis's 25 us, and shorter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numba
import numpy as np

from .. import problems
from ..problems import PERIOD, PERIODS, SAMPLES
from ..worker import Case, serve
from .equations import contact_of, rates


@numba.njit
def simulate(contact, steps):
    """The positions; `steps` per period, a multiple of the samples."""
    h, every = PERIOD / steps, steps // SAMPLES
    found = np.zeros(PERIODS * SAMPLES + 1)
    y = w = z = x = s = 0.0
    n = 0
    for _ in range(PERIODS):
        for i in range(steps):
            t = i * h
            m, e, a = t + 0.5 * h, t + h, 0.5 * h
            y1, w1, z1, x1, s1 = rates(t, y, w, z, s, contact)
            y2, w2, z2, x2, s2 = rates(m, y + a * y1, w + a * w1, z + a * z1, s + a * s1, contact)
            y3, w3, z3, x3, s3 = rates(m, y + a * y2, w + a * w2, z + a * z2, s + a * s2, contact)
            y4, w4, z4, x4, s4 = rates(e, y + h * y3, w + h * w3, z + h * z3, s + h * s3, contact)
            y += h / 6.0 * (y1 + 2.0 * y2 + 2.0 * y3 + y4)
            w += h / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
            z += h / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4)
            x += h / 6.0 * (x1 + 2.0 * x2 + 2.0 * x3 + x4)
            s += h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
            if (i + 1) % every == 0:
                n += 1
                found[n] = x
    return found


def simulator(problem: str, step: float) -> Callable[[], np.ndarray]:
    return partial(simulate, contact_of(problem), round(PERIOD / (step * 1e-6)))


def trajectory() -> Iterator[Case]:
    for problem, steps in (("P1", (25.0, 10.0, 2.5)), ("P2", (1.25,))):
        for step in steps:
            yield Case(
                "RK4 in Numba",
                "fixed step",
                f"{step:g} us",
                problem,
                partial(simulator, problem, step),
                partial(problems.error, problem),
            )


if __name__ == "__main__":
    serve({"trajectory": trajectory}, ["numba"])
