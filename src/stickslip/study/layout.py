"""Layout of a study's results: variables over dimensions, divided into tasks.

A task is a block of members; its results are one chunk (file) of each variable.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

# Limits of the default number of members per task: at most MOST, and few enough that the study has TASKS
# tasks, so that all processors have work.
MOST, TASKS = 8192, 64
# Largest size in memory of a task's results, for the default number of members per task, bytes.
LARGEST = 64_000_000
TEXT = "text"
MOST_DIMS = 32  # largest number of dimensions of a study; the limit of NumPy 1 and HDF5
# Largest number of tasks: each task has a file per variable, and a resumed run looks for all status files.
MOST_TASKS = 10_000_000
# Largest size of one variable's chunk, bytes: twice `LARGEST`. Reading a chunk takes twice this memory.
MOST_CHUNK_BYTES = 128_000_000


class StudyVariable(NamedTuple):
    """Description of one variable in the store, a result or a varied value.

    `dims` names the dimensions of the study that the variable has, `inner` the variable's further dimensions
    (such as time) with their sizes. `dtype` is the name of a NumPy type, or "text". `about` contains the
    attributes, such as `units`.
    """

    name: str
    dims: tuple[str, ...]
    inner: tuple[tuple[str, int], ...]
    dtype: str
    about: dict[str, Any]

    @property
    def missing(self) -> Any:
        """Return the value that marks results not computed yet.

        It is "" for texts, -1 for the status (int8), and NaN for numbers.
        """
        return "" if self.dtype == TEXT else -1 if self.dtype == "int8" else float("nan")


class Layout(NamedTuple):
    """Layout of all results of a study in its store.

    `dims` and `shape` are the dimensions of the study and their sizes. A task is a block of members; `task`
    is the number of its members along each dimension, and the last task of a dimension may have fewer.
    `variables` are in the order of writing: the status is last, so that a task with a status file is
    complete.
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
        """Return the slice of indices that the task `number` covers in each dimension, by name."""
        at = np.unravel_index(number, self.counts)
        return {
            dim: slice(int(i) * part, min((int(i) + 1) * part, size))
            for dim, i, part, size in zip(self.dims, at, self.task, self.shape, strict=True)
        }

    def chunk(self, variable: StudyVariable) -> tuple[int, ...]:
        """Return the shape of a variable's chunk: a task's members along each dimension, then `inner` sizes.

        All chunks have this shape: a chunk at the end of a dimension is padded with fill values.
        """
        part = dict(zip(self.dims, self.task, strict=True))
        return (*(part[dim] for dim in variable.dims), *(size for _, size in variable.inner))

    def size(self, variable: StudyVariable) -> int:
        """Return the size of a variable's chunk in memory, bytes; for texts, 8 bytes per reference alone."""
        one = 8 if variable.dtype == TEXT else np.dtype(variable.dtype).itemsize
        return one * math.prod(self.chunk(variable))

    def whole(self, variable: StudyVariable) -> tuple[int, ...]:
        """Return the shape of a variable's array over all members of the study."""
        size = dict(zip(self.dims, self.shape, strict=True))
        return (*(size[dim] for dim in variable.dims), *(count for _, count in variable.inner))

    def key(self, variable: StudyVariable, number: int) -> str:
        """Return the path of the file with a variable's chunk of the task `number`, relative to the store.

        The path is "VARIABLE/c/I/J/...", with the task's index along each dimension of the variable, and 0
        for each `inner` dimension.
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
    """Divide a study into tasks; return the number of members of a task along each dimension.

    A task has at most `wanted` members in all. The last dimensions are kept undivided as far as possible.
    `shape` has the sizes of the study's dimensions.
    """
    parts, left = [], max(1, wanted)
    for size in reversed(shape):
        parts.append(min(size, left))
        left = max(1, left // size)
    return tuple(reversed(parts))


def usual(members: int, bytes_of_one: int) -> int:
    """Return the default number of members per task: the largest power of two within three limits.

    A task has at most `MOST` members and `LARGEST` bytes of results, and a study at least `TASKS` tasks. A
    study of fewer members has tasks of one member.

    Args:
        members: number of members of the study.
        bytes_of_one: size of the results of one member in memory, bytes.
    """
    most = min(MOST, max(1, members // TASKS), max(1, LARGEST // max(1, bytes_of_one)))
    return 1 << (most.bit_length() - 1)


def layout_text(layout: Layout) -> str:
    """Return the layout as JSON text."""
    return json.dumps(layout._asdict() | {"variables": [v._asdict() for v in layout.variables]})


def layout_of(found: Mapping[str, Any]) -> Layout:
    """Return the layout from the decoded JSON of `layout_text`, after the checks of `check_layout`.

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
    """Raise ValueError for an impossible layout, such as one from a damaged or foreign file.

    Names must be identifiers, because others could lead out of the store. Numbers of dimensions and tasks and
    sizes of chunks have limits. The last variable must be the status, over all dimensions, with the meanings
    of its codes; just one variable, the reason, must be of texts. Missing attributes of the status raise
    LookupError.
    """
    for name in (*layout.dims, *(v.name for v in layout.variables)):
        if not str(name).isidentifier():
            raise ValueError(f"{str(name)[:60]!r} is no name of a variable: take letters, digits and _")
    if not (MOST_DIMS >= len(layout.dims) == len(layout.shape) == len(layout.task) > 0):
        raise ValueError(f"it has no sizes of 1 to {MOST_DIMS} dimensions")
    if min(layout.shape + layout.task) < 1:
        raise ValueError("its dimensions and tasks have sizes below 1")
    if layout.tasks > MOST_TASKS:
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
