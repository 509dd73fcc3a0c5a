"""The state of a study, from its store alone: whoever works on it, on whatever machine."""

from __future__ import annotations

import math
import os
import time
from typing import NamedTuple

import numpy as np

from .chunks import ChunkError
from .store import Store

# s, within which tasks are counted for the rate.
LATELY = 300.0
# State of members with an unreadable status; a resumed run computes them again.
DAMAGED = "damaged"


class StudyState(NamedTuple):
    """Progress of a study, read from its store.

    `done` of `tasks` are finished; members are counted in all and by their status; the rate is in members per
    second of late, NaN where nothing was written of late; `left` is the remaining time at this rate, s;
    `last` is the time of the last result, s (Unix time), NaN for none; `damage` describes a damaged finished
    task, or is "". Results are only checked for existence.
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
    """Return the progress of a study.

    Raises:
        StudyError: the folder is not a store of a study.
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
    """Ask all processes that work on a study, on any machine that sees its store, to end within a second or
    so.

    Finished tasks are kept; a run of the same study resumes.

    Raises:
        StudyError: the folder is not a store of a study.
        OSError: the store cannot be written.
    """
    Store(path).stop()
