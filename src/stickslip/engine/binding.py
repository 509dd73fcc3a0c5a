"""Calls of the compiled engine with NumPy arrays.

Arrays are passed without a copy: each must be a C-contiguous array of doubles, otherwise a TypeError names
it. The engine runs without Python's global interpreter lock (GIL), so that threads run in parallel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..friction.law import element, elements
from ..quantities.units import QuantityError
from ._abi import ffi
from .called_back import running
from .law_of import EngineLaw, law_of
from .laws import parameters, row
from .library import library

Array = NDArray[np.float64]
_NULL = ffi.NULL
# Number of columns of the account of work. Each is an integral over time, up to each sample, of a power:
# - b u dq/dt summed over the modes (drive u, its coefficient b), per unit of mass;
# - c (dq/dt)^2 summed over the modes (damping c), per unit of mass;
# - f s summed over the elements (force f, sliding velocity s);
# - f dq/dt of the last mode.
TERMS = 4
_SHARES = ("velocity", "push", "position", "feed")


class ComposedPlant:
    """A plant as a struct of the engine, usable for any number of runs.

    Args:
        plant: see `simulation.plant.system.Plant`.

    Attributes:
        struct: pointer to the C struct `plant`.
        laws: how the engine runs the law of each element.
        states: number of states of the plant.
        columns: number of columns of its samples: the states, then the output of each element (at least one).
        resume_size: number of internal numbers of the solver, see `integrate`.

    Raises:
        QuantityError: the plant is larger than the engine allows, or pushes a mode along which the normal
            force of another element changes.
        TypeError: an element has no law.
    """

    def __init__(self, plant: Any) -> None:
        lib = library()
        most = (lib.LARGEST_MODES, lib.LARGEST_ELEMENTS)
        if len(plant.modes) > most[0] or len(plant.elements) > most[1]:
            raise QuantityError(_too_large(plant, lib))
        self.struct: Any = ffi.new("struct plant *")
        self.struct.modes, self.struct.elements = len(plant.modes), len(plant.elements)
        self.struct.rate = plant.rate
        for m, mode in enumerate(plant.modes):
            self.struct.mode[m] = tuple(mode)
        self.laws: list[EngineLaw] = []
        self._arrays: list[Any] = []  # arrays that must exist as long as the struct, which points into them
        for e, one in enumerate(plant.elements):
            self._fill(self.struct.element[e], one)
        if lib.stickslip_compose(self.struct) != lib.DONE:
            raise QuantityError(_too_large(plant, lib))
        _refuse_shared_place(self.struct)
        self.states: int = self.struct.states
        self.columns = self.states + max(len(plant.elements), 1)
        self.resume_size: int = lib.stickslip_resume_size(self.struct)

    def _fill(self, made: Any, one: Any) -> None:
        states, law = elements(one.law), law_of(element(one.law, 0))
        self.laws.append(law)
        numbers = ffi.new("real_t[]", parameters(one.law) or [0.0])
        self._arrays.append(numbers)
        made.law, made.parameters = law.pointer, numbers
        if one.along is not None:
            along: Any = ffi.new("ss_NormalForce *", row(one.along))
            self._arrays.append(along)
            made.along = along
        for name in _SHARES:
            shares = getattr(one, name)
            if shares:
                getattr(made, name)[0 : len(shares)] = [share or 0.0 for share in shares]
        made.normal, made.drive, made.drive_rate = one.normal, one.drive or 0.0, one.drive_rate or 0.0
        made.states, made.loaded, made.follows = states, one.loaded is not None, one.drive_rate is not None
        made.positioned, made.fed = bool(one.position), bool(one.feed)
        made.felt, made.pushed = _bits(one.velocity), _bits(one.push)


class DriveTable:
    """Segment table of a drive or a load (`waveform.drive.Drive`) as a C struct of the engine, `struct`."""

    def __init__(self, drive: Any) -> None:
        self.struct: Any = ffi.new("struct table *")
        columns = (drive.start, drive.polynomial, drive.harmonic)
        start, polynomial, harmonic = (doubles(np.ascontiguousarray(one), "drive") for one in columns)
        numbers: Any = np.ascontiguousarray(drive.first, dtype=np.int64)
        first = ffi.from_buffer("int64_t[]", numbers)
        self._arrays = (start, polynomial, first, harmonic)
        self.struct.segments, self.struct.start, self.struct.first = len(start), start, first
        self.struct.polynomial = ffi.cast("real_t (*)[4]", polynomial)
        self.struct.harmonic = ffi.cast("real_t (*)[4]", harmonic)


def integrate(
    plant: ComposedPlant,
    drive: DriveTable,
    load: DriveTable,
    q: Array,
    span: tuple[float, float],
    tolerance: float,
    careful: bool,
    max_steps: int,
    times: Array,
    samples: Array,
    resume: Array | None = None,
    account: Array | None = None,
) -> tuple[int, float, int, int]:
    """Integrate one trajectory of a plant.

    Args:
        plant: the plant.
        drive: input of the plant.
        load: normal force over its reference.
        q: state [plant.states] at the start; becomes the state at the time reached.
        span: start and end, s.
        tolerance: bound of the local error of positions, m (rad for a rotary actuator).
        careful: True if small vibrations of sticking contacts must be resolved.
        max_steps: largest number of accepted plus rejected steps.
        times: s, of the samples, ascending.
        samples: states and outputs of the elements (N for a contact) [times, plant.columns], filled up to the
            time reached.
        resume: internal numbers of the solver [plant.resume_size] from which to continue, replaced by those
            at the end; zeros: start from q.
        account: account of work [times, TERMS], filled; it does not change the steps.

    Returns:
        The outcome (see `engine.outcome`), the time reached [s], accepted and rejected steps.

    Raises:
        TypeError: an array is no C-contiguous array of doubles.
        ValueError: an array has another size than the plant and the times ask for.
        MemoryError: there is no room for the log of steps.
        BaseException: whatever a user's law in Python has raised.
    """
    if resume is not None:
        sized("resume", resume, plant.resume_size)
    if account is not None:
        sized("account", account, TERMS * times.size)
    task = filled_task(plant, drive, load, q, span, tolerance, careful, max_steps, times, samples)
    task.resume = _NULL if resume is None else doubles(resume, "resume", True)
    task.account = _NULL if account is None else doubles(account, "account", True)
    result: Any = ffi.new("struct stickslip_result *")
    outcome = called(library().stickslip_integrate, plant.laws, task, result)
    return outcome, result.reached, result.accepted, result.rejected


def filled_task(
    plant: ComposedPlant,
    drive: DriveTable,
    load: DriveTable,
    q: Array,
    span: tuple[float, float],
    tolerance: float,
    careful: bool,
    max_steps: int,
    times: Array,
    samples: Array,
) -> Any:
    """Return the C struct `stickslip_task` with the arguments of `integrate`, whose arrays must exist as long
    as the struct.

    Raises:
        TypeError, ValueError: see `integrate`.
    """
    sized("q", q, plant.states)
    sized("samples", samples, times.size * plant.columns)
    task: Any = ffi.new("struct stickslip_task *")
    task.plant, task.drive, task.load = plant.struct, drive.struct, load.struct
    task.state, task.begin, task.end = doubles(q, "q", True), span[0], span[1]
    task.tolerance, task.max_steps, task.careful = tolerance, max_steps, careful
    task.count, task.times = times.size, doubles(times, "times")
    task.samples = doubles(samples, "samples", True)
    return task


def called(function: Any, laws: Sequence[EngineLaw], task: Any, *further: Any) -> int:
    """Call a function of the engine with a task, and return its outcome (see `engine.outcome`).

    If a law runs as plain Python, the task gets a flag through which an exception of the law stops the run.

    Args:
        function: function of the C library.
        laws: laws of the elements, as the engine runs them.
        task: pointer to a C struct with a field `stop`, the first argument of the function.
        further: further arguments of the function.

    Raises:
        MemoryError: there is no room for the log of steps.
        BaseException: the exception that a user's law in Python has raised.
    """
    if any(law.how == "python" for law in laws):
        with running() as stop:
            task.stop = stop
            outcome = function(task, *further)
    else:
        outcome = function(task, *further)
    if outcome == library().NO_MEMORY:
        raise MemoryError("the engine has no memory for its log of steps")
    return outcome


def doubles(array: Array, name: str, written: bool = False) -> Any:
    """Return a C pointer to an array of doubles; the pointer keeps the array alive. `name` is for messages,
    `written`: the engine writes into the array.

    Raises:
        TypeError: the array is not C-contiguous, or not of doubles.
    """
    if array.dtype != np.float64 or not array.flags.c_contiguous:
        raise TypeError(f"{name} must be a C-contiguous array of doubles, not of {array.dtype}")
    buffer: Any = array
    return ffi.from_buffer("real_t[]", buffer, require_writable=written)  # type: ignore[call-overload]


def contiguous(values: Array) -> Any:
    """Return a C pointer to a readable copy of numbers in any layout, or to the array itself if it is
    contiguous."""
    return doubles(np.ascontiguousarray(values, dtype=float), "numbers")


def sized(name: str, array: NDArray[Any], size: int) -> None:
    """Raise ValueError, with the `name` of the array, unless an array has the `size` that the engine
    needs."""
    if array.size != size:
        raise ValueError(f"{name} has {array.size} numbers; the engine needs {size}")


def _bits(shares: tuple[float | None, ...]) -> int:
    return sum(1 << m for m, share in enumerate(shares) if share is not None)


def _refuse_shared_place(struct: Any) -> None:
    """Raise QuantityError for a plant (C struct) whose integration step cannot be solved.

    This is so if the normal force of an element depends on the position of a mode that another element
    pushes, or if the element pushes no mode."""
    elements = [struct.element[e] for e in range(struct.elements)]
    for e, one in enumerate(elements):
        if one.along and not one.pushed:
            raise QuantityError(f"element {e} pushes no mode along which its normal force could change")
        for i, other in enumerate(elements):
            if one.along and i != e and other.pushed >> one.place & 1:
                raise QuantityError(
                    f"the normal force of element {e} changes along mode {one.place}, which element {i} "
                    "pushes too: give one of them a constant normal force or another mode"
                )


def _too_large(plant: Any, lib: Any) -> str:
    return (
        f"a plant of {len(plant.modes)} modes and {len(plant.elements)} elements is too large for the "
        f"engine, which has room for {lib.LARGEST_MODES} modes, {lib.LARGEST_ELEMENTS} elements and, in all, "
        f"{lib.LARGEST_STATES} states"
    )
