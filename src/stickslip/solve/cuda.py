"""Members of an ensemble on a GPU, a thread each: the physics and the steps are those of the CPU."""

from __future__ import annotations

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from ..plant.generated import state_of, with_values
from ..plant.system import Plant
from ..waveform.drive import Drive
from ..waveform.members import Drives, member_of
from .outcome import DONE
from .periods import follow

THREADS = 128


def available() -> bool:
    """Whether there is a GPU to run on (or its simulator, NUMBA_ENABLE_CUDASIM=1)."""
    return bool(cuda.is_available())


@cuda.jit
def _members(plant, drives, values, states, spans, tolerance, careful, max_steps, none, results):
    m = cuda.grid(1)  # pyright: ignore[reportCallIssue]
    outcomes, reached, steps = results
    if m >= states.shape[0] or outcomes[m] != DONE:
        return
    tables, which, load = drives
    drive = member_of(tables, which[m])
    own, state = with_values(plant, values[m]), state_of(plant, states[m])
    outcome, t, accepted, rejected, state = follow(
        own, drive, load, state, spans[m], tolerance, careful, max_steps, *none, None, None, None
    )
    outcomes[m], reached[m], steps[m] = outcome, t, accepted + rejected
    for c in range(len(state)):
        states[m, c] = state[c]


def integrate_members(
    plant: Plant,
    drives: tuple[Drives, NDArray[np.int64], Drive],
    values: NDArray[np.float64],
    states: NDArray[np.float64],
    spans: NDArray[np.float64],
    tolerance: float,
    careful: bool,
    max_steps: int,
    results: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]],
) -> None:
    """As `periods.integrate_members`, without samples; `states` and `results` change in place."""
    none = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
    blocks = -(-len(states) // THREADS)
    _members[blocks, THREADS](  # type: ignore[index]
        plant, drives, values, states, spans, tolerance, careful, max_steps, none, results
    )
