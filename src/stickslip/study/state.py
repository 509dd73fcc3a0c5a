"""Progress of a study, read from its store alone, and the request to stop a study, both from any machine."""

from __future__ import annotations

import math
import os
import time
from typing import NamedTuple

import numpy as np

from .chunks import ChunkError
from .store import Store

# Length of the time before now, s: tasks that were written in this time determine the rate of a study.
LATELY = 300.0
# Name of the status under which members of damaged tasks are counted; a resumed run computes them again.
DAMAGED = "damaged"


class StudyState(NamedTuple):
    """Progress of a study, read from its store.

    `done` of `tasks` tasks are finished. `members` is the number of all members, and `statuses` the number of
    computed members by the name of their status; members of damaged tasks have the status `DAMAGED`. `rate`
    is the number of members per second in the last `LATELY` seconds, NaN without two tasks in this time.
    `left` is the remaining time at this rate, s, NaN if the rate is. `last` is the time of the last result
    (Unix time, s), NaN without results. `damage` describes the first damaged task and its repair, "" for
    none: only the status and the seal of a task are read for this, of its other files the existence is
    checked.
    """

    title: str
    tasks: int
    done: int
    members: int
    statuses: dict[str, int]
    rate: float
    left: float
    last: float
    damage: str = ""

    @property
    def finished(self) -> bool:
        return self.done == self.tasks


def study_state(path: str | os.PathLike[str]) -> StudyState:
    """Return the progress of a study, given the folder of its store.

    Raises:
        StudyError: the folder is not a store of a study, or its metadata are damaged.
    """
    store, now = Store(path), time.time()
    layout, status = store.layout, store.layout.variables[-1]
    done, written = store.done(), store.written()
    names = dict(zip(status.about["flag_values"], str(status.about["flag_meanings"]).split(), strict=True))
    counts: dict[str, int] = dict.fromkeys(names.values(), 0)
    damage = ""
    for number in np.flatnonzero(done).tolist():
        try:
            if gone := store.lacks(number):
                raise ChunkError(gone)
            codes, many = np.unique(store.read(number, status), return_counts=True)
            found = {
                names.get(code, DAMAGED): n for code, n in zip(codes.tolist(), many.tolist(), strict=True)
            }
        except ChunkError as error:
            damage = damage or store.repair(number, str(error))
            place = layout.place(number).values()
            found = {DAMAGED: math.prod(part.stop - part.start for part in place)}
        for name, n in found.items():
            counts[name] = counts.get(name, 0) + n
    lately = written[written > now - LATELY]
    each = layout.members / layout.tasks
    rate = float("nan")
    if lately.size > 1 and np.ptp(lately) > 0.0 and now - lately.max() < LATELY:
        rate = each * (lately.size - 1) / float(np.ptp(lately))
    return StudyState(
        store.title,
        layout.tasks,
        int(done.sum()),
        layout.members,
        counts,
        rate,
        each * float((~done).sum()) / rate,
        float(written.max(initial=-np.inf)) if written.size else float("nan"),
        damage,
    )


def stop_study(path: str | os.PathLike[str]) -> None:
    """Ask all processes that run a study, on any machine that sees its store, to stop.

    They stop within about a second, unless they are reconnecting to a scheduler, and lose their unfinished
    tasks. Finished tasks are kept. Runs that start later do not stop: running the same study again resumes
    it.

    Raises:
        StudyError: the folder is not a store of a study.
        OSError: the store cannot be written.
    """
    Store(path).stop()
