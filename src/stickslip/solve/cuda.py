"""Members of an ensemble on a GPU, a thread each: the physics and the steps are those of the CPU."""

from __future__ import annotations

from threading import Lock
from typing import Any

import numpy as np
from numba import config, cuda, typeof
from numpy.typing import NDArray

from ..plant.generated import state_of, with_values
from ..plant.system import Plant
from ..waveform.drive import Drive
from ..waveform.members import Drives, member_of
from .outcome import DONE
from .periods import follow

THREADS = 128
# Blocks of members at once: while one is integrated, the next is made ready. The simulator can do one.
AT_ONCE = 1 if getattr(config, "ENABLE_CUDASIM", 0) else 2
config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # pyright: ignore[reportAttributeAccessIssue]  # a few members are no mistake


def available() -> bool:
    """Whether there is a GPU to run on (or its simulator, NUMBA_ENABLE_CUDASIM=1)."""
    return bool(cuda.is_available())


_KERNELS: dict[Any, Any] = {}  # by the type of the plant
_ONE = Lock()  # makes them


def _kernel(plant: Plant, count: int) -> Any:
    """The kernel of plants of this type, which have so many numbers.

    CUDA takes no argument in which something is None, as a plant without a piezo has it. So the kernel is
    compiled for a plant that it knows, of which no number counts: each member puts in its own.
    """
    kind = typeof(plant)
    with _ONE:
        if kind not in _KERNELS:
            _KERNELS[kind] = _compiled(with_values(plant, np.full(count, np.nan)))
        return _KERNELS[kind]


def _compiled(like: Plant) -> Any:
    @cuda.jit
    def members(drives, values, spans, changed, tolerance, careful, max_steps, none):
        m = cuda.grid(1)  # pyright: ignore[reportCallIssue]
        states, outcomes, reached, steps = changed
        if m >= states.shape[0] or outcomes[m] != DONE:
            return
        tables, which, load = drives
        drive = member_of(tables, which[m])
        own, state = with_values(like, values[m]), state_of(like, states[m])
        # fmt: off
        outcome, t, accepted, rejected, state = follow(  # CUDA takes no *arguments either
            own, drive, load, state, spans[m], tolerance, careful, max_steps, none[0], none[1], none[2],
            None, None, None,
        )
        # fmt: on
        outcomes[m], reached[m], steps[m] = outcome, t, accepted + rejected
        for c in range(len(state)):
            states[m, c] = state[c]

    return members


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
    """As `engine.members.integrate_members`, without samples; `states` and `results` change in place."""
    none = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
    stream = cuda.stream()  # so that what another thread sends is worked on meanwhile
    changed = states, *results
    there = _sent(changed, stream)
    kernel = _kernel(plant, values.shape[1])[-(-len(states) // THREADS), THREADS, stream]
    kernel(*_sent((drives, values, spans), stream), there, tolerance, careful, max_steps, _sent(none, stream))
    for here, column in zip(changed, there, strict=True):
        column.copy_to_host(here, stream)
    stream.synchronize()


def _sent(given: Any, stream: Any) -> Any:
    """Arrays, and tuples of them, on the GPU."""
    if not isinstance(given, tuple):
        return cuda.to_device(np.ascontiguousarray(given), stream)
    parts = (_sent(part, stream) if isinstance(part, tuple | np.ndarray) else part for part in given)
    return tuple.__new__(type(given), parts)
