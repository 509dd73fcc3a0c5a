"""The state of a study, from its store alone: whoever works on it, on whatever machine."""

from __future__ import annotations

import os
import time
from typing import NamedTuple

import numpy as np

from .store import Store, open_study

# s, within which tasks are counted for the rate, and after which nobody seems to be at work.
LATELY, SILENT = 300.0, 600.0


class State(NamedTuple):
    """`done` of `tasks`; members in all, and those computed by their status; members per second lately, NaN
    where nothing was written lately; `left` [s], of the rest at this rate; `last` [s, Unix time], when
    something was written, NaN: never."""

    title: str
    tasks: int
    done: int
    members: int
    statuses: dict[str, int]
    rate: float
    left: float
    last: float

    @property
    def finished(self) -> bool:
        return self.done == self.tasks


def study_state(path: str | os.PathLike[str]) -> State:
    """How far a study is.

    Raises:
        StudyError: it is no store of a study.
    """
    store = Store(path)
    layout, whole, now = store.layout, open_study(path), time.time()
    done, written = store.done(), store.written()
    flags = whole["status"].attrs
    names = dict(zip(flags["flag_values"], str(flags["flag_meanings"]).split(), strict=True))
    counts: dict[str, int] = dict.fromkeys(names.values(), 0)
    for number in np.flatnonzero(done).tolist():
        codes, many = np.unique(whole["status"].isel(store.layout.place(number)).values, return_counts=True)
        for code, count in zip(codes.tolist(), many.tolist(), strict=True):
            counts[names[code]] += count
    lately = written[written > now - LATELY]
    each = layout.members / layout.tasks
    rate = float("nan")
    if lately.size > 1 and np.ptp(lately) > 0.0 and now - lately.max() < LATELY:
        rate = each * (lately.size - 1) / float(np.ptp(lately))
    return State(
        str(whole.attrs["title"]),
        layout.tasks,
        int(done.sum()),
        layout.members,
        counts,
        rate,
        each * float((~done).sum()) / rate,
        float(written.max(initial=-np.inf)) if written.size else float("nan"),
    )
