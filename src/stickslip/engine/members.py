"""Integrate many trajectories with the engine: members of one plant layout, each with its own numbers, drive
and state."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction.law import element
from ..quantities.records import numbers_in, with_numbers
from ._abi import ffi
from .binding import Array, ComposedPlant, DriveTable, called, doubles, sized
from .laws import parameters, row
from .library import library

Integers = NDArray[np.int64]


class _Structs:
    """An array of C structs of one kind, whose fields are set in all structs at once, without a loop in
    Python.

    Args:
        kind: C type of the struct.
        count: number of structs.
    """

    def __init__(self, kind: str, count: int) -> None:
        self.pointer: Any = ffi.new(f"{kind}[]", count)
        self._kind, self._shape = kind, (count, ffi.sizeof(kind))
        self._memory: Any = ffi.buffer(self.pointer)
        self._arrays: list[Any] = []  # arrays that must exist as long as the structs, which point into them

    def fill(self, like: Any) -> None:
        """Copy the C struct `like` into all structs."""
        one: Any = ffi.buffer(like)
        np.frombuffer(self._memory, np.uint8).reshape(self._shape)[:] = np.frombuffer(one, np.uint8)

    def put(self, values: Any, dtype: Any, *place: str | int) -> None:
        """Set a field in all structs.

        Args:
            values: number for all structs, or an array with a number for each.
            dtype: NumPy type of the field.
            place: path of the field: names of fields and indices of arrays.
        """
        if self._shape[0] == 0:
            return
        offset = ffi.offsetof(self._kind, *place)
        column: Any = np.ndarray(self._shape[:1], dtype, self._memory, offset, self._shape[1:])
        column[:] = values

    def point(self, rows: NDArray[Any], which: Integers, *place: str | int) -> None:
        """Set a pointer in all structs to a row of an array.

        Args:
            rows: array, whose first axis are the rows; it is kept alive.
            which: index of the row for each struct.
            place: path of the pointer field, as for `put`.
        """
        self._arrays.append(rows)
        self.put(rows.ctypes.data + which * rows.strides[0], np.uintp, *place)


class ComposedMembers:
    """Plants of one layout with different numbers, as the engine takes them.

    Args:
        plant: one plant with this layout, see `simulation.plant.system.Plant`.
        values: numbers of each plant [members, numbers], in the order of `simulation.plant.system.values_of`.

    Attributes:
        struct: pointer to the C array of plants.
        count: number of plants.
        states: number of states of each plant.
        laws: how the engine runs the law of each element.

    Raises:
        QuantityError: the plant is larger than the engine allows.
        TypeError: an element has no law.
    """

    def __init__(self, plant: Any, values: Array) -> None:
        like, self.count = ComposedPlant(plant), len(values)
        self.states, self.laws = like.states, like.laws
        self._structs = _Structs("struct plant", self.count)
        self._structs.fill(like.struct)
        self.struct = self._structs.pointer
        each = np.arange(self.count)
        for place, given in numbers_of(plant, values):
            if given.ndim == 2:
                self._structs.point(given, each, *place)
            else:
                self._structs.put(given, np.float64, *place)
        # Compose each plant on its own, because the result depends on which of its numbers are zero.
        for m in range(self.count):
            library().stickslip_compose(self.struct + m)


class MemberDrives:
    """Drives of the members as a C array of tables, `struct`, with `count` members.

    Args:
        drives: segment tables, see `waveform.members.Drives`.
        which: index in `drives` of each member's table.

    Raises:
        ValueError: an index is out of range.
    """

    def __init__(self, drives: Any, which: Integers) -> None:
        self.count, known = which.size, len(drives.start)
        if self.count and not 0 <= which.min() <= which.max() < known:
            raise ValueError(f"there are {known} drives, and which = {which.min()} to {which.max()}")
        structs = _Structs("struct table", self.count)
        structs.put(drives.start.shape[1], np.int64, "segments")
        for name in ("start", "polynomial", "first", "harmonic"):
            dtype = np.int64 if name == "first" else np.float64
            structs.point(np.ascontiguousarray(getattr(drives, name), dtype), which, name)
        self._structs, self.struct = structs, structs.pointer


class Followed(NamedTuple):
    """Results of members.

    Fields: `reached`, times reached [members], s; `steps` tried [members]; `samples`, values of one state
    [members, times], NaN after the time reached.
    """

    reached: Array
    steps: Integers
    samples: Array


def integrate_members(
    members: ComposedMembers,
    drives: MemberDrives,
    load: DriveTable,
    outcomes: Integers,
    states: Array,
    spans: Array,
    tolerance: float,
    careful: bool,
    max_steps: int,
    times: Array,
    column: int,
) -> Followed:
    """Integrate many trajectories, one after the other.

    Args:
        members: the plants.
        drives: drive of each member.
        load: normal force over its reference, the same for all.
        outcomes: outcome of each member (see `engine.outcome`), in place; members whose outcome is not DONE
            at the start are left out.
        states: states at the start [members, states], replaced by those at the time reached.
        spans: start and end of each run, s, [members, 2].
        tolerance, careful, max_steps, times: see `binding.integrate`.
        column: index of the state that is sampled.

    Raises:
        TypeError, ValueError, MemoryError: see `binding.integrate`.
        BaseException: whatever a user's law in Python has raised.
    """
    count = members.count
    given = (outcomes, count), (states, count * members.states), (spans, 2 * count)
    for name, (array, size) in zip(("outcomes", "states", "spans"), given, strict=True):
        sized(name, array, size)
    check_fit(members, drives, column)
    samples = np.full((count, times.size), np.nan)
    found = Followed(np.zeros(count), np.zeros(count, np.int64), samples)
    task: Any = ffi.new("struct stickslip_members *")
    task.count, task.plants, task.drives, task.load = count, members.struct, drives.struct, load.struct
    task.states = doubles(states, "states", True)
    task.spans = ffi.cast("real_t (*)[2]", doubles(spans, "spans"))
    task.tolerance, task.max_steps, task.careful = tolerance, max_steps, careful
    task.samples, task.times, task.column = times.size, doubles(times, "times"), column
    task.positions, task.reached = doubles(samples, "samples", True), doubles(found.reached, "reached", True)
    task.outcomes, task.steps = integers(outcomes, "outcomes"), integers(found.steps, "steps")
    called(library().stickslip_integrate_members, members.laws, task)
    return found


def numbers_of(plant: Any, values: Array) -> Iterator[tuple[tuple[str | int, ...], Array]]:
    """Yield pairs, one for each number of a plant: its path in the C struct `plant` (names and indices), and
    its value for each member, [members].

    Where the struct has a pointer (parameters of a law, a normal force along the stroke), the values are rows
    [members, numbers].

    Args:
        plant, values: see `ComposedMembers`.
    """
    numbers = iter(values.T)
    for m, mode in enumerate(plant.modes):
        for name in mode._fields:
            yield ("mode", m, name), next(numbers)
    for e, one in enumerate(plant.elements):
        yield ("element", e, "parameters"), _parameters(one.law, numbers, len(values))
        for name, value in zip(one._fields[1:], one[1:], strict=True):
            if name == "along" and value is not None:
                yield ("element", e, name), np.stack([next(numbers) for _ in value], axis=1)
            elif name == "loaded" and value is not None:
                next(numbers)  # skip this number: it is 1 for all members, and a flag in C
            elif isinstance(value, tuple):
                for i, share in enumerate(value):
                    if share is not None:
                        yield ("element", e, name, i), next(numbers)
            elif value is not None:
                yield ("element", e, name), next(numbers)
    yield ("rate",), next(numbers)


def check_fit(members: ComposedMembers, drives: MemberDrives | None, column: int) -> None:
    """Raise ValueError if there are drives, but not one per member, or if `column` is not the index of a
    state."""
    if drives is not None and drives.count != members.count:
        raise ValueError(f"there are {members.count} plants and {drives.count} drives")
    if not 0 <= column < members.states:
        raise ValueError(f"there is no state {column}: the plants have {members.states}")


def integers(array: Integers, name: str) -> Any:
    """Return a C pointer to an array of 64-bit integers; the pointer keeps the array alive. `name` is for
    messages.

    Raises:
        TypeError: the array is not C-contiguous, or not of 64-bit integers.
    """
    if array.dtype != np.int64 or not array.flags.c_contiguous:
        raise TypeError(f"{name} must be a C-contiguous array of 64-bit integers, not of {array.dtype}")
    buffer: Any = array
    return ffi.from_buffer("int64_t[]", buffer)  # type: ignore[call-overload]


def _parameters(law: Any, numbers: Iterator[Array], count: int) -> Array:
    """Return the parameters of a friction law for each member, [members, numbers], as the engine reads them.

    Args:
        law: any of the laws, which gives their type.
        numbers: iterator over columns [members], the next of which are the numbers of the law's own fields.
        count: number of members.
    """
    given = np.empty((count, sum(1 for _ in numbers_in(law))))
    for place in given.T:
        place[:] = next(numbers)
    if element(law, 0) is law and len(row(law)) == given.shape[1]:
        return given
    own = [with_numbers(law, iter(values)) for values in given.tolist()]
    return np.array([parameters(one) for one in own])
