"""Two stores compared, and stores of shards put together."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..quantities.progress import Progress, unheard
from .chunks import part_beside
from .description import differences
from .errors import StudyDiffers, StudyError
from .reading import blocks, open_study
from .store import Store


class StudyComparison(NamedTuple):
    """Difference of one variable between two stores: how many members differ, the largest difference in its
    unit (NaN where no two numbers differ), and how many members have a number in one store only."""

    name: str
    unit: str
    members: int
    greatest: float
    alone: int


class Compared(NamedTuple):
    """Result of comparing two studies.

    `said` lists the differences between the descriptions. Further fields give the number of members computed
    in one store only and in both, and a `StudyComparison` per variable.
    """

    said: list[str]
    only_first: int
    only_second: int
    both: int
    variables: list[StudyComparison]

    @property
    def equal(self) -> bool:
        """Return True if both studies have identical results, to the last bit."""
        return not (self.only_first or self.only_second or any(v.members for v in self.variables))


def compare_studies(
    first: str | os.PathLike[str], second: str | os.PathLike[str], progress: Progress = unheard
) -> Compared:
    """Compare the results of two studies over the same members, part by part.

    Args:
        first, second: their stores; the studies may differ, but not in their members' dimensions.
        progress: called after each part.

    Raises:
        StudyError: one is no store of a study, or a damaged one.
        StudyDiffers: their dimensions, or what varies along them, differ.
    """
    a, b = Store(first), Store(second)
    if (a.layout.dims, a.layout.shape) != (b.layout.dims, b.layout.shape):
        shapes = [dict(zip(s.layout.dims, s.layout.shape, strict=True)) for s in (a, b)]
        raise StudyDiffers(f"{a.path} is over {shapes[0]}, {b.path} over {shapes[1]}")
    for one in (a, b):
        one.check_results()
    other = open_study(b.path)
    members, greatest, units, alone = {}, {}, {}, Counter[str]()
    counts = np.zeros(3, dtype=int)
    for i, (place, mine) in enumerate(blocks(a)):
        there = other.isel(place).load()
        for name in map(str, mine.indexes):
            if not np.array_equal(mine[name].values, there[name].values):
                raise StudyDiffers(f"{a.path} and {b.path} differ in the values of {name}")
        done = [one["status"].values != -1 for one in (mine, there)]
        both = done[0] & done[1]
        counts += [int((done[0] & ~done[1]).sum()), int((done[1] & ~done[0]).sum()), int(both.sum())]
        for name in (str(n) for n in mine.data_vars if n in there):
            x, y = mine[name].values, there[name].values
            off = _apart(x, y)
            extra = tuple(range(both.ndim, off.ndim))
            members[name] = members.get(name, 0) + int((off.any(axis=extra) & both).sum())
            units[name] = str(mine[name].attrs.get("units", ""))
            if x.dtype.kind == "f":
                differing = np.abs(x - y)[off & both.reshape(both.shape + (1,) * len(extra))]
                numbers = differing[~np.isnan(differing)]
                if numbers.size:
                    greatest[name] = max(greatest.get(name, 0.0), float(numbers.max()))
                alone[name] += int(((np.isnan(x) != np.isnan(y)).any(axis=extra) & both).sum())
        progress("comparing", (i + 1) / a.layout.tasks)
    found = [
        StudyComparison(n, units[n], members[n], greatest.get(n, float("nan")), alone[n]) for n in members
    ]
    first_only, second_only, both = counts.tolist()
    return Compared(differences(a.description, b.description), first_only, second_only, both, found)


def _apart(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    missing = np.isnan(x) & np.isnan(y) if x.dtype.kind == "f" else np.zeros(x.shape, dtype=bool)
    return (x != y) & ~missing


def merge_studies(
    stores: Sequence[str | os.PathLike[str]], into: str | os.PathLike[str], progress: Progress = unheard
) -> int:
    """Put stores of one study together, each with its share of the tasks; chunks are checked on the way.

    Args:
        stores: of the same study, with tasks of the same size.
        into: a new store, or one of the stores, which gets what it lacks.
        progress: called after tasks.

    Returns:
        How many tasks are missing still.

    Raises:
        StudyDiffers: they are of different studies.
        StudyError: one is no store, or has a damaged task that no other has whole.
    """
    sources = [Store(path) for path in stores]
    if not sources:
        raise StudyError("there is nothing to merge")
    first, target = sources[0], Path(into)
    if not (target / "zarr.json").exists():
        _begin(first, target)
    merged = Store(target)
    damaged = {}
    for store in sources:
        store.check(merged.description)
        if store.layout != merged.layout:
            raise StudyDiffers(f"{store.path} has tasks of other members than {target}: give both one 'task'")
        done, there = store.done(), merged.done()
        for number in np.flatnonzero(done & ~there).tolist():
            if damage := store.damage(number):
                damaged[number] = f"{store.path}: task {number}: {damage}"
                continue
            merged.copy(store, number)
            damaged.pop(number, None)
            progress("merging", number / merged.layout.tasks)
    if damaged:
        raise StudyError(f"{next(iter(damaged.values()))}, and no other store has it")
    return int((~merged.done()).sum())


def _begin(first: Store, target: Path) -> None:
    """Make a store without results, from another one of the same study."""
    first.check_known()
    begun = part_beside(target)
    try:
        for name in ("zarr.json", *first.files):
            (begun / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(first.path / name, begun / name)
        begun.rename(target)
    except OSError as error:
        raise StudyError(f"{target}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(begun, ignore_errors=True)
