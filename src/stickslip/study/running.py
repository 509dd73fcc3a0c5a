"""Runner of studies: it estimates the cost, creates or opens the store, and gives the tasks to workers."""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..quantities.progress import Progress, unheard
from ..quantities.units import QuantityError
from ..simulation.errors import SimulationWarning
from .creating import create
from .description import described
from .design import Study
from .errors import StudyError
from .layout import Layout, layout_text
from .local import processors, run_local
from .reading import open_study
from .store import Store, has_arrays
from .task import Done, load_of

if TYPE_CHECKING:
    import xarray as xr

# Largest number of members that are computed in order to estimate the cost of a study.
TRIAL = 64
# Shortest time between progress reports: the larger of OFTEN seconds and the fraction SHARE of the time since
# the start.
OFTEN, SHARE = 2.0, 0.01


class Estimate(NamedTuple):
    """Estimated cost of a study.

    `members` and `tasks` are their numbers, `cpu` is the processor time of all members [s], `bytes` the size
    of the results on the disk without texts, and `seconds` the processor time per member [s].
    """

    members: int
    tasks: int
    cpu: float
    bytes: int
    seconds: float

    def __str__(self) -> str:
        hours = f"{self.cpu / 3600:.3g} CPU hours" if self.cpu > 360 else f"{self.cpu:.3g} s of CPU"
        return (
            f"{self.members:,} members in {self.tasks:,} tasks, about {hours} and {self.bytes / 1e6:.3g} MB"
        )


def estimate_study(study: Study) -> Estimate:
    """Estimate the cost of a study by computing up to `TRIAL` members, chosen at random with a fixed seed.

    The first two members are computed before that, as for `Study.layout`.

    Raises:
        QuantityError: a part of the study is impossible.
        StudyError: the first two members fail, so that the results' names and shapes are unknown.
    """
    layout, place = study.layout(), {}
    random = np.random.default_rng(0)
    chosen = []
    for _ in range(min(TRIAL, layout.members)):
        place = {dim: int(random.integers(size)) for dim, size in zip(layout.dims, layout.shape, strict=True)}
        chosen.append(study.columns({dim: slice(i, i + 1) for dim, i in sorted(place.items())}))
    columns = {name: np.concatenate([one[name] for one in chosen]) for name in chosen[0]}
    begun = time.process_time()
    study.computed(columns)
    seconds = (time.process_time() - begun) / len(chosen)
    return Estimate(layout.members, layout.tasks, seconds * layout.members, layout.bytes, seconds)


def run_study(
    study: Study,
    store: str | os.PathLike[str],
    *,
    workers: int | None = None,
    shard: tuple[int, int] | None = None,
    scheduler: str | None = None,
    progress: Progress = unheard,
) -> xr.Dataset:
    """Run a study of many members, or resume it after an interruption.

    After any interruption only the unfinished tasks are lost, and the results equal those of an uninterrupted
    run to the last bit. On this machine the study runs in worker processes with one thread each. On several
    machines, either each machine computes a share of the tasks into one store (`shard`), or the workers of a
    dask scheduler (extra ``stickslip[cluster]``) compute them; all workers must see the same folder. At the
    start, finished tasks of the share are checked against their checksums; damaged ones are computed again
    with a warning.

    Args:
        study: members, computation and results of the study.
        store: folder of the results, a Zarr group (format 3) that `xarray.open_zarr` opens at any time:
            status is -1 where nothing is computed yet. It is created if missing.
        workers: number of processes on this machine, by default one per processor that this process may use;
            without effect if there is a `scheduler`.
        shard: (k, n), k from 1 to n: compute only every n-th task, starting with the k-th.
        scheduler: address of a dask scheduler, "tcp://host:8786".
        progress: called from time to time, and after the last task, with a text (activity, speed, remaining
            time) and the finished fraction of the activity, from 0 to 1. The first activity is the check.

    Returns:
        The results, as `open_study` opens them: over the dimensions of the grid, "member" of a random
        design, "draw" of draws. Members of other shares may be missing (status -1).

    Raises:
        QuantityError: a part of the study is impossible, or an argument is out of range.
        StudyDiffers: the store belongs to another study, another version of the package, or other compiled
            physics, or has tasks of more members than `Study.task`; the message says what differs.
        StudyError: tasks failed three times, no worker starts, no scheduler answers, the study cannot be sent
            to workers, the store is damaged, the disk is full, or the study was asked to stop. Finished tasks
            are kept.

    Warns:
        SimulationWarning: results in the store were damaged.
    """
    if workers is not None and not workers > 0:
        raise QuantityError(f"workers = {workers} must be > 0")
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        raise QuantityError(f"shard = {shard[0]}/{shard[1]}: k of k/n is from 1 to n")
    there = prepared(study, store)
    todo = _todo(there, shard, progress)
    heard = _ToldProgress(there.layout, len(todo), progress)
    if todo and scheduler is not None:
        from .cluster import run_on_cluster

        failed = run_on_cluster(load_of(study, there), todo, scheduler, heard)
    elif todo:
        failed = run_local(load_of(study, there, sys.path), todo, workers or processors(), heard)
    else:
        failed = {}
    if failed:
        number, why = next(iter(failed.items()))
        raise StudyError(
            f"{len(failed)} of {len(todo)} tasks failed, task {number} with: {why}; the others are finished, "
            "and the same command tries these again"
        )
    return open_study(there.path)


def prepared(study: Study, path: str | os.PathLike[str]) -> Store:
    """Return the store of a study in the folder `path`; the store is created if missing.

    The metadata of the store are checked, and partial files that killed processes left there more than a day
    ago are removed.

    Raises:
        StudyDiffers: the store belongs to another study, or has larger tasks than the study asks for.
        QuantityError: the study is impossible or cannot be stored.
        StudyError: the store is damaged, or cannot be created.
    """
    description = described(study)
    if not (Path(path) / "zarr.json").exists() and not has_arrays(Path(path)):
        create(path, description, study.layout(), study.axes, study.inner(), study.title)
    there = Store(path)
    there.check(description, study.task)
    # The hash of the study's description, which `check` compares, does not cover the layout.
    if _of(there.layout) != _of(study.layout()):
        raise StudyError(
            f"{there.path}: its layout is not that of the study, with {study.layout().members:,} members: "
            "was its zarr.json changed? Take another store"
        )
    there.check_known()
    there.tidy()
    return there


def _of(layout: Layout) -> list[Any]:
    """Return the parts of a layout that must agree between a study and its store, as a list to compare.

    They are the dimensions, their sizes, and name, dimensions and type of each variable. The size of the
    tasks and the attributes of variables may differ.
    """
    found = json.loads(layout_text(layout))
    fields = ("name", "dims", "inner", "dtype")
    return [found["dims"], found["shape"], [[one[key] for key in fields] for one in found["variables"]]]


def _todo(store: Store, shard: tuple[int, int] | None, progress: Progress) -> list[int]:
    """Return the numbers of the tasks that are still to compute.

    Finished tasks are checked first; the status files of damaged ones are deleted, with a SimulationWarning,
    so that the store no longer counts these tasks as done.

    Args:
        store: store of the study.
        shard: (k, n), the share of the tasks, see `run_study`; None for all tasks.
        progress: called for every 100th task of the check with a text and the checked fraction, from 0 to 1.
    """
    k, n = shard or (1, 1)
    mine, done, damaged = range(k - 1, store.layout.tasks, n), store.done(), []
    for i, number in enumerate(mine):
        if done[number] and (damage := store.damage(number)):
            damaged.append(f"task {number}: {damage}")
            store.forget(number)
            done[number] = False
        if i % 100 == 0 and done.any():
            progress("checking what is done", i / len(mine))
    if damaged:
        text = f"{store.path}: computed again: {'; '.join(damaged[:4])}"
        more = f"; and {len(damaged) - 4} more" if len(damaged) > 4 else ""
        warnings.warn(text + more, SimulationWarning, stacklevel=3)
    return [number for number in mine if not done[number]]


class _ToldProgress:
    """Reporter of a run's progress, called with the report (`Done`) of each finished task.

    At increasing intervals (`OFTEN`, `SHARE`), and after the last task, it calls `progress` with speed and
    remaining time as text, and the finished fraction of the `tasks` of this run.
    """

    def __init__(self, layout: Layout, tasks: int, progress: Progress) -> None:
        self._layout, self._tasks, self._progress = layout, tasks, progress
        self._begun = self._last = 0.0
        self._done = self._members = self._failed = 0

    def __call__(self, done: Done) -> None:
        self._done += 1
        self._members += done.members
        self._failed += done.failed
        now = time.monotonic()
        if not self._begun:  # the run's time is counted from the start of the task that finishes first
            self._begun = self._last = now - done.seconds
        passed = now - self._begun
        if self._done < self._tasks and now - self._last < max(OFTEN, SHARE * passed):
            return
        self._last = now
        left = passed * (self._tasks / self._done - 1.0)
        rate = self._members / passed
        text = f"computing: {pace(rate)}, {duration(left)} left"
        if self._failed:
            text += f", {self._failed:,} members failed"
        self._progress(text, self._done / self._tasks)


def pace(rate: float) -> str:
    """Return a rate [members/s] as text: members per second, or per minute below 10 members/s."""
    return f"{rate:,.0f} members/s" if rate >= 10.0 else f"{60.0 * rate:,.2g} members/min"


def duration(seconds: float) -> str:
    """Return a duration given in s as text, in the largest of d, h and min of which it has two or more, else
    in s.
    """
    for unit, size in (("d", 86_400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"
