"""Layout of a study's results: variables over dimensions, divided into tasks.

A task is a block of members; its results are one chunk (file) of each variable.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

# Limits of the default number of members per task: at most MOST members, and few enough for TASKS tasks, so
# that all processors have work.
MOST, TASKS = 8192, 64
# Largest size of a task's results in memory that the default number of members gives, bytes.
LARGEST = 64_000_000
TEXT = "text"
MOST_DIMS = 32  # largest number of dimensions of a study; the limit of NumPy 1 and HDF5
MOST_TASKS = 10_000_000  # largest number of tasks; each task is a file per variable, and files are looked for
MOST_CHUNK_BYTES = 128_000_000  # largest chunk, twice `LARGEST`; a reader needs twice this memory


class StudyVariable(NamedTuple):
    """Description of one variable in the store, a result or a varied value.

    `dims` names the dimensions of the study that the variable has, `inner` the variable's own dimensions
    (such as time) with their sizes. `dtype` is the name of a NumPy type, or "text". `about` contains the
    attributes, such as units.
    """

    name: str
    dims: tuple[str, ...]
    inner: tuple[tuple[str, int], ...]
    dtype: str
    about: dict[str, Any]

    @property
    def missing(self) -> Any:
        """Return the value that stands for results that are not computed yet.

        It is "" for texts, -1 for the status (int8), and NaN for numbers.
        """
        return "" if self.dtype == TEXT else -1 if self.dtype == "int8" else float("nan")


class Layout(NamedTuple):
    """Layout of all results of a study in its store.

    `dims` and `shape` are the dimensions of the study and their sizes. `task` is the number of members of a
    task along each dimension. `variables` are in the order of writing: the status is last, so that a task
    with a status is complete.
    """

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    task: tuple[int, ...]
    variables: tuple[StudyVariable, ...]

    @property
    def members(self) -> int:
        return math.prod(self.shape)

    @property
    def counts(self) -> tuple[int, ...]:
        """Return the number of tasks along each dimension."""
        return tuple(-(-size // part) for size, part in zip(self.shape, self.task, strict=True))

    @property
    def tasks(self) -> int:
        return math.prod(self.counts)

    @property
    def bytes(self) -> int:
        """Return the size of all results on the disk without texts, bytes."""
        return self.tasks * sum(self.size(v) for v in self.variables if v.dtype != TEXT)

    def place(self, number: int) -> dict[str, slice]:
        """Return for each dimension the slice of indices that a task covers; `number` is that of the task."""
        at = np.unravel_index(number, self.counts)
        return {
            dim: slice(int(i) * part, min((int(i) + 1) * part, size))
            for dim, i, part, size in zip(self.dims, at, self.task, self.shape, strict=True)
        }

    def chunk(self, variable: StudyVariable) -> tuple[int, ...]:
        """Return the shape of a variable's chunks.

        All chunks have it: a chunk at the end of a dimension is padded with fill values.
        """
        part = dict(zip(self.dims, self.task, strict=True))
        return (*(part[dim] for dim in variable.dims), *(size for _, size in variable.inner))

    def size(self, variable: StudyVariable) -> int:
        """Return the size of a variable's chunk in memory, bytes; for texts that of the references alone."""
        one = 8 if variable.dtype == TEXT else np.dtype(variable.dtype).itemsize
        return one * math.prod(self.chunk(variable))

    def whole(self, variable: StudyVariable) -> tuple[int, ...]:
        """Return the shape of a variable's array over all members of the study."""
        size = dict(zip(self.dims, self.shape, strict=True))
        return (*(size[dim] for dim in variable.dims), *(count for _, count in variable.inner))

    def key(self, variable: StudyVariable, number: int) -> str:
        """Return the path of the file with a variable's chunk of a task, relative to the store.

        `number` is the number of the task.
        """
        at = dict(zip(self.dims, np.unravel_index(number, self.counts), strict=True))
        return "/".join(
            [
                variable.name,
                "c",
                *(str(int(at[dim])) for dim in variable.dims),
                *("0" for _ in variable.inner),
            ]
        )


def cut(shape: tuple[int, ...], wanted: int) -> tuple[int, ...]:
    """Return the number of members of a task along each dimension, at most `wanted` in all.

    The last dimensions are kept undivided as far as possible.
    """
    parts, left = [], max(1, wanted)
    for size in reversed(shape):
        parts.append(min(size, left))
        left = max(1, left // size)
    return tuple(reversed(parts))


def usual(members: int, bytes_of_one: int) -> int:
    """Return the default number of members per task, a power of two.

    It gives at least `TASKS` tasks (of one member, if the study has fewer), of at most `MOST` members and
    `LARGEST` bytes each.

    Args:
        members: number of members of the study.
        bytes_of_one: size of the results of one member, bytes.
    """
    most = min(MOST, max(1, members // TASKS), max(1, LARGEST // max(1, bytes_of_one)))
    return 1 << (most.bit_length() - 1)


def layout_text(layout: Layout) -> str:
    """Return the layout as JSON text."""
    return json.dumps(layout._asdict() | {"variables": [v._asdict() for v in layout.variables]})


def layout_of(found: Mapping[str, Any]) -> Layout:
    """Return the layout from the content of the JSON text that `layout_text` wrote.

    Raises:
        LookupError, TypeError, ValueError: the content is not a layout.
    """
    made = Layout(
        tuple(found["dims"]),
        tuple(map(int, found["shape"])),
        tuple(map(int, found["task"])),
        tuple(_variables(found["variables"])),
    )
    check_layout(made)
    return made


def check_layout(layout: Layout) -> None:
    """Raise ValueError for an impossible layout.

    A layout from a damaged or foreign file could have names that lead out of the store, wrong sizes, or no
    status and reason.
    """
    for name in (*layout.dims, *(v.name for v in layout.variables)):
        if not str(name).isidentifier():
            raise ValueError(f"{str(name)[:60]!r} is no name of a variable: take letters, digits and _")
    if not (MOST_DIMS >= len(layout.dims) == len(layout.shape) == len(layout.task) > 0):
        raise ValueError(f"it has no sizes of 1 to {MOST_DIMS} dimensions")
    if min(layout.shape + layout.task) < 1 or layout.tasks > MOST_TASKS:
        raise ValueError(f"it would have {layout.tasks:.3g} tasks; up to {MOST_TASKS:,} are possible")
    for one in layout.variables:
        if not {*one.dims} <= {*layout.dims} or (one.dtype != TEXT and np.dtype(one.dtype).kind not in "fiu"):
            raise ValueError(f"{one.name}: no such variable is possible")
        if layout.size(one) > MOST_CHUNK_BYTES:
            raise ValueError(
                f"a task would have {layout.size(one) / 1e6:,.0f} MB of {one.name}; up to "
                f"{MOST_CHUNK_BYTES / 1e6:g} MB are possible: take fewer members a task (task: ...)"
            )
    status = layout.variables[-1]
    texts = [v.dtype for v in layout.variables].count(TEXT)
    if status[:3] != ("status", layout.dims, ()) or status.dtype == TEXT or texts != 1:
        raise ValueError("it has no reasons and status")
    codes, meanings = status.about["flag_values"], status.about["flag_meanings"].split()
    if not all(isinstance(code, int) for code in codes) or len(codes) != len(meanings):
        raise ValueError("its statuses have no meanings")


def _variables(listed: list[dict[str, Any]]) -> Iterator[StudyVariable]:
    for one in listed:
        inner = tuple((str(dim), int(size)) for dim, size in one["inner"])
        yield StudyVariable(**{**one, "dims": tuple(one["dims"]), "inner": inner})
