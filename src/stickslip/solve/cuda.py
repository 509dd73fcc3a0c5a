"""Members of an ensemble on a GPU, a thread each: the physics and the steps are those of the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda, float64
from numpy.typing import NDArray

from ..friction.law import with_fields
from ..mechanism import Mechanism, with_coefficients
from ..waveform.drive import Drive
from .bristle import CLOCK, LOG_COLUMNS
from .outcome import DONE
from .periods import follow

THREADS = 128


def available() -> bool:
    """Whether there is a GPU to run on (or its simulator, NUMBA_ENABLE_CUDASIM=1)."""
    return bool(cuda.is_available())


@cuda.jit
def _members(law, mech, drive, load, laws, mechs, states, span, tolerance, max_steps, none, results):
    m = cuda.grid(1)  # pyright: ignore[reportCallIssue]
    outcomes, reached, steps = results
    if m >= states.shape[0] or outcomes[m] != DONE:
        return
    q, before = cuda.local.array(5, float64), cuda.local.array(5, float64)
    clock = cuda.local.array(CLOCK, float64)
    for c in range(5):
        q[c] = states[m, c]
    times, samples, log = none
    outcome, t, accepted, rejected = follow(
        with_fields(law, laws[m]),
        with_coefficients(mech, mechs[m]),
        drive,
        load,
        q,
        span,
        tolerance,
        max_steps,
        times,
        samples,
        log,
        None,
        clock,
        before,
    )
    outcomes[m], reached[m], steps[m] = outcome, t, accepted + rejected
    for c in range(5):
        states[m, c] = q[c]


def integrate_members(
    law: Any,
    mech: Mechanism,
    drive: Drive,
    load: Drive,
    laws: NDArray[np.float64],
    mechs: NDArray[np.float64],
    states: NDArray[np.float64],
    span: NDArray[np.float64],
    tolerance: float,
    max_steps: int,
    results: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]],
) -> None:
    """As `periods.integrate_members`, without samples; `states` and `results` change in place."""
    none = np.zeros(0), np.zeros((0, 6)), np.zeros((0, LOG_COLUMNS))
    blocks = -(-len(states) // THREADS)
    _members[blocks, THREADS](  # type: ignore[index]
        law, mech, drive, load, laws, mechs, states, span, tolerance, max_steps, none, results
    )
