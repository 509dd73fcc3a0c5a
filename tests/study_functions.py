"""Functions that studies of the tests use; workers import them from this file."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import xarray as xr


def with_functions(file: Path, text: str) -> Path:
    """Write a study's file, and beside it this one, which it names as FILE."""
    (file.parent / Path(__file__).name).write_bytes(Path(__file__).read_bytes())
    file.write_text(text.replace("FILE", Path(__file__).name))
    return file


def squares(columns):
    """x^2 + 10 y, and a line in a log for each call, where a log is asked for."""
    x, y = columns["x"], columns["y"]
    if "STUDY_LOG" in os.environ:
        with open(os.environ["STUDY_LOG"], "a", encoding="utf-8") as log:
            log.write(f"{x[0]} {y[0]} {x.size}\n")
    return {"value": xr.DataArray(x**2 + 10.0 * y, dims="member", attrs={"units": "m"})}


def slow_squares(columns):
    """As `squares`, in 20 ms."""
    time.sleep(0.02)
    return squares(columns)


def gated_squares(columns):
    """As `squares`; tasks of three members, which a trial is not, from x = 3 on only once a file is there."""
    while columns["x"].size == 3 and columns["x"][0] >= 3.0 and not Path(os.environ["STUDY_GATE"]).exists():
        time.sleep(0.02)
    return squares(columns)


def once_stopped(columns):
    """As `squares`; of two workers one stops itself with its first real task, for good."""
    mark = Path(os.environ["STUDY_MARK"])
    if columns["x"].size > 2:
        try:
            mark.touch(exist_ok=False)
        except FileExistsError:
            pass
        else:
            os.kill(os.getpid(), 19)  # SIGSTOP
    return squares(columns)


def deadly(columns):
    """Kills its process where x is 3; fails where x is 5."""
    if np.any(columns["x"] == 3.0):
        os.kill(os.getpid(), 9)
    return squares(columns)


def picky(columns):
    """Refuses members with x of 5."""
    if np.any(columns["x"] == 5.0):
        raise ValueError("x = 5 cannot be")
    return squares(columns)


def overshoot(found):
    """The farthest position over the last one, of walks with trajectories."""
    position = found["end_effector_position"]
    return {"overshoot": (position.max("time") - position.isel(time=-1)).assign_attrs(units="m")}
