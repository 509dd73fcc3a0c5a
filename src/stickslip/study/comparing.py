"""Comparison of two stores of studies, and merging of stores that contain shares of one study."""

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
    """Difference of one result between two stores, over the members that are computed in both.

    `name` is the result's name. `members` is the number of members that differ. `greatest` is the largest
    difference of two numbers in `unit`, NaN if no two numbers differ. `alone` is the number of members with a
    number in one store and NaN in the other; they also count as different.
    """

    name: str
    unit: str
    members: int
    greatest: float
    alone: int


class Compared(NamedTuple):
    """Result of comparing two studies.

    `said` lists the differences between the studies' descriptions, in words. `only_first` and `only_second`
    are the numbers of members that are computed in one store only, `both` is the number of members computed
    in both. `variables` has a `StudyComparison` for each result that both stores contain, status and reason
    included. The varied values of random designs and of draws are not compared.
    """

    said: list[str]
    only_first: int
    only_second: int
    both: int
    variables: list[StudyComparison]

    @property
    def equal(self) -> bool:
        """Return True if the same members are computed, with equal values of all common results.

        Equal means without a tolerance; NaN equals NaN. The studies' descriptions (`said`) may differ.
        """
        return not (self.only_first or self.only_second or any(v.members for v in self.variables))


def compare_studies(
    first: str | os.PathLike[str], second: str | os.PathLike[str], progress: Progress = unheard
) -> Compared:
    """Compare the results of two studies over the same members.

    If the dimensions agree, both stores are checked completely for damage. The comparison then reads one task
    of the first store at a time, so that the memory suffices for large stores.

    Args:
        first, second: folders of the stores. The studies may differ, but not in names and sizes of their
            dimensions, nor in the values of a grid, nor in the own dimension of a common result, such as
            time.
        progress: called after each task with a text and the finished fraction, from 0 to 1.

    Returns:
        The differences of descriptions, computed members and values.

    Raises:
        StudyError: a folder is no store of a study, or a store is damaged.
        StudyDiffers: the dimensions of the studies or of a common result differ, or values of a grid or of a
            result's own dimension.
    """
    a, b = Store(first), Store(second)
    if (a.layout.dims, a.layout.shape) != (b.layout.dims, b.layout.shape):
        shapes = [dict(zip(s.layout.dims, s.layout.shape, strict=True)) for s in (a, b)]
        raise StudyDiffers(f"{a.path} is over {shapes[0]}, {b.path} over {shapes[1]}")
    for one in (a, b):
        one.check_results()
    whole, other = open_study(a.path), open_study(b.path)
    common = [str(n) for n in whole.data_vars if n in other.data_vars]
    for name in common:
        over = [dict(zip(one[name].dims, one[name].shape, strict=True)) for one in (whole, other)]
        if list(over[0].items()) != list(over[1].items()):
            raise StudyDiffers(f"{name} is over {over[0]} in {a.path}, over {over[1]} in {b.path}")
    members, greatest, units, alone = {}, {}, {}, Counter[str]()
    counts = np.zeros(3, dtype=int)
    for i, (place, mine) in enumerate(blocks(a)):
        there = other.isel(place).load()
        for name in map(str, mine.indexes):
            if name in there.indexes and not np.array_equal(mine[name].values, there[name].values):
                raise StudyDiffers(f"{a.path} and {b.path} differ in the values of {name}")
        done = [one["status"].values != -1 for one in (mine, there)]
        both = done[0] & done[1]
        counts += [int((done[0] & ~done[1]).sum()), int((done[1] & ~done[0]).sum()), int(both.sum())]
        for name in common:
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
    """Copy the finished tasks of several stores of one study into one store.

    Each task is checked against its checksums before it is copied.

    Args:
        stores: folders of stores of the same study, with tasks of the same size.
        into: folder of a new store, or of an existing store of the study, which gets the tasks that it lacks.
        progress: called after each copied task with a text and the task's number over the number of all
            tasks, from 0 up to below 1; it starts again with each of `stores`.

    Returns:
        The number of unfinished tasks of the study, which none of the stores has.

    Raises:
        StudyDiffers: the stores belong to different studies, or have tasks of different sizes.
        StudyError: there are no stores, a folder is no store of a study, or `into` cannot be created; or a
            task is damaged and no other store has it undamaged (the undamaged tasks are copied all the same).
        OSError: a task cannot be written.
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
    """Create the store `target` without results, with copies of metadata and coordinates of the store
    `first`.

    Raises StudyError if the metadata of `first` are damaged, or the new folder cannot be written.
    """
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
