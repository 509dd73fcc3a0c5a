"""Search a laboratory's folder for runs (recordings, fits, experiments, parameter sets) without reading them.
Samples of killed programs become recordings first."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..rig.samples import SAMPLES, recover
from .describing import BESIDE, RECORDINGS

SETS = "parameters"  # name of the laboratory's subfolder with parameter sets that were saved from fits
LOGS = ("experiment.log", "experiment.yaml")  # an experiment's folder has at least one of these files
MOST_LEVELS = 40  # largest depth of nested folders that is searched; usual laboratories have up to 6


class FoundRun(NamedTuple):
    """A run that was found by the names of its files, or a folder that cannot be searched. A run may turn out
    to be unreadable.

    Fields: `path`; `kind`; `changed`, time of the last change [s since 1970]; `bytes`, size; and `problem`,
    the reason why the run must not be read, or "". The kind is "recording", "fit", "parameters" (a parameter
    set), "run" (an experiment's folder without a recording) or "folder" (a folder that cannot be searched).
    """

    path: str
    kind: str
    changed: float
    bytes: int
    problem: str = ""


def entries(root: str) -> Iterator[FoundRun]:
    """Yield the runs in a folder and its subfolders, except hidden ones and those inside a study's store.

    Samples that a killed program has left in a folder are first converted to a recording. A subfolder that
    cannot be listed, or whose own subfolders are not searched because they lie more than `MOST_LEVELS` levels
    deep, yields a `FoundRun` of the kind "folder". If `root` itself cannot be listed, nothing is yielded.
    """
    waiting = [(root, 0)]
    while waiting:
        folder, level = waiting.pop()
        try:
            with os.scandir(folder) as found:
                there = sorted(found, key=lambda one: one.name)
            if any(one.name.startswith(".") and one.name.endswith(SAMPLES) for one in there) and recover(
                Path(folder), 0.0
            ):
                with os.scandir(folder) as found:
                    there = sorted(found, key=lambda one: one.name)
        except OSError as error:
            if folder != root:
                yield FoundRun(folder, "folder", 0.0, 0, f"it cannot be listed: {error.strerror}")
            continue
        names = {one.name for one in there}
        yield from _fit(root, folder, names)
        yield from _without_recording(root, folder, names)
        for one in there:
            if kind := _kind(root, folder, one):
                yield from _looked_at(root, one.path, kind)
        if folder != root and "zarr.json" in names:
            # The store of a study has many subfolders and no recordings in them.
            continue
        below = [one.path for one in there if not one.name.startswith(".") and _is_folder(one)]
        if below and level == MOST_LEVELS:
            text = f"its folders are not searched: they are more than {MOST_LEVELS} levels deep"
            yield FoundRun(folder, "folder", 0.0, 0, text)
        else:
            waiting += [(path, level + 1) for path in reversed(below)]


def is_run(root: str, path: str) -> bool:
    """Return True if the file or folder at `path` is a run, by the rules of `entries` for the folder `root`;
    False if it is missing or cannot be examined."""
    folder = os.path.dirname(path)
    try:
        with os.scandir(folder) as found:
            entry = next((one for one in found if one.path == path), None)
        if entry is None:
            return False
        if _is_folder(entry):
            names = {*os.listdir(path)}
            return any(_fit(root, path, names)) or any(_without_recording(root, path, names))
        return _kind(root, folder, entry) != ""
    except OSError:
        return False


def _kind(root: str, folder: str, entry: os.DirEntry[str]) -> str:
    suffix = os.path.splitext(entry.name)[1]
    if entry.name.startswith(".") or _is_folder(entry):
        return ""
    if suffix == ".toml" and folder == os.path.join(root, SETS):
        return "parameters"
    return "recording" if suffix.lower() in RECORDINGS else ""


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir(follow_symlinks=False)
    except OSError:
        return False


def _fit(root: str, folder: str, names: set[str]) -> Iterator[FoundRun]:
    """Yield one `FoundRun` if a folder other than `root` is that of a fit (with results.json and report.html,
    without experiment.log); otherwise nothing.

    Its time of change is the latest, and its size the sum, of results.json and of the files in `BESIDE`.

    Args:
        root: folder of the laboratory.
        folder: the folder to examine.
        names: names of the files and folders in it.
    """
    if folder == root or not {"results.json", "report.html"} <= names or "experiment.log" in names:
        return
    files = ["results.json", *(one for one in BESIDE if one in names)]
    parts = [part for one in files for part in _looked_at(root, os.path.join(folder, one), "fit")]
    if parts:
        problem = next((f"{one.problem} ({os.path.basename(one.path)})" for one in parts if one.problem), "")
        changed, size = max(one.changed for one in parts), sum(one.bytes for one in parts)
        yield FoundRun(folder, "fit", changed, size, problem)


def _without_recording(root: str, folder: str, names: set[str]) -> Iterator[FoundRun]:
    """Yield one `FoundRun` if a folder is that of an experiment that has ended, or has just started, without
    a recording; otherwise nothing. The arguments are those of `_fit`.

    A folder with samples that are being recorded or were left unfinished does not count.
    """
    log = next((one for one in LOGS if one in names), None)
    if folder == root or log is None or "unfinished" in names:
        return
    if any(one.endswith(SAMPLES) or os.path.splitext(one)[1].lower() in RECORDINGS for one in names):
        return
    for part in _looked_at(root, os.path.join(folder, log), "run"):
        yield part._replace(path=folder)


def _looked_at(root: str, path: str, kind: str) -> Iterator[FoundRun]:
    """Yield one `FoundRun` of this kind for the file at `path`; nothing if the file was deleted.

    Its `problem` says why the file must not be read: a link leads out of the folder `root` or nowhere, or the
    file is a pipe or device.
    """
    try:
        one = os.lstat(path)
    except OSError:
        return
    problem = ""
    if stat.S_ISLNK(one.st_mode):
        try:
            there = os.stat(path)
            if os.path.commonpath([root, os.path.realpath(path)]) == root:
                one = there
            else:
                problem = "a link that leads out of the folder: it is not followed"
        except OSError as error:
            # The target of the link is missing, or is the link itself.
            problem = f"a link that leads nowhere: {error.strerror}"
    if not problem and not stat.S_ISREG(one.st_mode):
        problem = "no plain file"
    yield FoundRun(path, kind, one.st_mtime, one.st_size, problem)
