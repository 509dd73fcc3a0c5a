"""Start of jobs: an experiment, with a folder for its recordings, and the walk home. Also counts virtual
runs, and adds notes of users to recordings."""

from __future__ import annotations

import itertools
import math
import re
import shutil
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..history import note_act
from ..history.describing import annotate
from ..quantities.input_file import yaml_text
from ..quantities.units import QuantityError, to_si, with_prefix
from ..recording import RecordingError
from ..recording.readers.process import Reader
from ..recording.replacing import replaced_whole
from ..rig import RigError
from ..rig.experiment.running import check_experiment
from ..rig.measurement import DRIVE, POSITION
from .document import BenchDocument
from .folder import Folder
from .journal import Journal
from .path import predicted_of
from .running import Arrived, BenchJob, Runner
from .stream import Hub

_HOMING = 10.0  # longest walk home, s
_LONGEST_NOTE = 2000  # length to which a note is shortened, characters


class Starter:
    """Starts experiments and the walk home; adds the notes of users to the recordings of a run."""

    def __init__(
        self,
        folder: Folder,
        hub: Hub,
        journal: Journal,
        document: BenchDocument,
        runner: Runner,
        read: Reader,
    ) -> None:
        self._folder, self._hub, self._journal, self._read = folder, hub, journal, read
        self._document, self._runner = document, runner
        self.queued = False  # True while a sequence is active, which alone may start runs
        self._notes: list[str] = []
        self._out: Path | None = None
        self._lock = threading.Lock()

    def start(
        self, content: dict[str, Any], title: str, slug: str, ended: Callable[[], None] | None = None
    ) -> str:
        """Start a job that records all runs of an experiment; return the name of its folder.

        This folder is for the recordings; the experiment file is saved in it, too. Virtual runs are counted,
        see `counted_on`.

        Args:
            content: content of the experiment file.
            title: title of the job, for pages and the log.
            slug: end of the folder's name.
            ended: called without arguments at the end of the job, also of a failed one, if given.

        Raises:
            ValueError, RigError: the experiment cannot be recorded, or a job is active.
        """
        if self._runner.busy:
            raise RigError("a run is going on: stop it first")
        with self._lock:
            content = counted_on(content, self._folder.root)
        file = check_experiment(content)
        out = new_folder(self._folder, _slug(slug))

        def finished() -> None:
            self._link(content, out)
            self._keep_notes(out)
            self._hub.tell("recordings")
            if ended is not None:
                ended()

        job = BenchJob(
            title, file, self._folder.root, out, self._document.described()["channels"], finished=finished
        )
        try:
            (out / "experiment.yaml").write_text(yaml_text(content), encoding="utf-8")
            with self._lock:
                self._runner.start(job)
                self._out, self._notes = out, []
        except RigError:  # another job was started in the meantime
            (out / "experiment.yaml").unlink()
            out.rmdir()
            raise
        return self._folder.name(out)

    def need_free(self) -> None:
        """Raise RigError while a sequence is active, because only the sequence may then start runs."""
        if self.queued:
            raise RigError("a sequence is going on: stop it, or let it end")

    def home(self) -> None:
        """Start the walk of the end-effector to position 0; raises the errors of `homing` and
        `Runner.start`."""
        self._runner.start(homing(self._folder, self._document, self._runner.position))

    def note(self, text: str) -> str:
        """Add a user's note to the recordings of the current or last run, and to the log.

        The note gets the time of day. During a run it is added at the run's end. The result is the name of
        the run's folder, "" if there was no run. Raises QuantityError for an empty note.
        """
        text = " ".join(text.split())[:_LONGEST_NOTE]
        if not text:
            raise QuantityError("a note has words")
        self._journal(f"note: {text}")
        with self._lock:
            out = self._out
            if out is None:
                return ""
            self._notes.append(f"[{datetime.now():%H:%M:%S}] {text}")
        if not self._runner.busy:
            self._keep_notes(out)
            self._hub.tell("recordings")
        return self._folder.name(out)

    def _keep_notes(self, out: Path) -> None:
        with self._lock:
            if out != self._out or not self._notes:
                return
            said, self._notes = " ".join(self._notes), []
        for path in out.rglob("*.nc"):
            with suppress(RecordingError, OSError):
                before = str(self._read(path).attrs.get("notes", ""))
                annotate(path, f"{before} {said}".strip(), read=self._read)

    def _link(self, content: dict[str, Any], out: Path) -> None:
        for run in content["runs"]:
            prediction = predicted_of(run)
            for path in out.rglob(f"{run['name']}*.nc") if prediction else ():
                with suppress(OSError):
                    note_act(self._folder.root, "recorded", self._folder.name(path), of=prediction)


def counted_on(content: dict[str, Any], root: Path) -> dict[str, Any]:
    """Return an experiment with the number of its first virtual run, and count its runs.

    The number is the key "first_run" of "rig". It seeds the random variation, so that no virtual run repeats
    an earlier one. The number of all runs is kept in the file .rig/runs of the panel's folder `root`; deleted
    recordings do not change it. An experiment on a real rig is returned unchanged.

    Raises:
        QuantityError: the file does not contain a number.
    """
    rig = content.get("rig", {})
    if rig.get("kind", "virtual") != "virtual":
        return content
    kept = root / ".rig" / "runs"
    try:
        before = int(kept.read_text(encoding="ascii"))
    except FileNotFoundError:  # an earlier version did not write this file
        before = len(list(root.glob("recordings/*")))
    except (OSError, ValueError):
        before = -1
    if before < 0:
        raise QuantityError(
            f"{kept} does not hold how many runs there were: write a whole number of 0 or more into it, "
            "more than there can have been"
        )
    kept.parent.mkdir(exist_ok=True, mode=0o700)
    with replaced_whole(kept) as temporary:
        temporary.write_text(str(before + _recordings(content)), encoding="ascii")
    return {**content, "rig": {**rig, "first_run": rig.get("first_run", 0) + before}}


def _recordings(content: dict[str, Any]) -> int:
    """Return the number of runs of the rig that an experiment needs, with repeats and averages.

    `content` is the content of the experiment file. An averaged recording needs several runs.
    """
    runs = check_experiment(content).runs
    return sum(
        run.repeats * int(run.capture.average) * math.prod(map(len, run.matrix.values())) for run in runs
    )


def new_folder(folder: Folder, slug: str) -> Path:
    """Create the folder "recordings/DATE_TIME_SLUG" in the panel's folder, and return its path.

    `slug` is the end of its name. A number is appended if the name exists, as for two runs in the same
    second.
    """
    stamp = datetime.now().strftime("%Y-%m-%d_%H%M%S")
    for number in itertools.count(1):
        made = folder.path(f"recordings/{stamp}_{slug}" + (f"_{number}" if number > 1 else ""))
        made.parent.mkdir(parents=True, exist_ok=True)
        try:
            made.mkdir()
        except FileExistsError:
            continue
        return made
    raise AssertionError


def _slug(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9-]+", "-", text)[:60].strip("-") or "run"


def homing(folder: Folder, document: BenchDocument, position: float) -> BenchJob:
    """Return the job of the walk home: steps until the end-effector is at position 0, near 0 V.

    The position counts while the drive is near 0 V. The walk uses the variables forward_voltage,
    reverse_voltage and frequency of the experiment. A position limit that is nearer than one stroke of the
    piezo, or exceeded, is widened for the walk. The recording of the walk is deleted at its end.

    Args:
        folder: the panel's folder.
        document: experiment on the bench.
        position: last measured position from home [m, or rad]; its sign gives the direction.

    Raises:
        QuantityError: the experiment lacks one of these variables, or a channel for the position.
    """
    content, file, _, units, *_ = document.checked
    walk = {"forward_voltage", "reverse_voltage", "frequency"}
    if not walk <= file.variables.keys() or POSITION not in units:
        raise QuantityError(
            f"the way home needs the variables {', '.join(sorted(walk))} and the channel {POSITION}"
        )
    unit = units[POSITION]
    shape, voltage = (
        ("ReverseSawtooth", "$reverse_voltage") if position > 0 else ("Sawtooth", "$forward_voltage")
    )
    waveform = {"shape": shape, "fields": {"amplitude": voltage, "frequency": "$frequency"}}
    run = {"name": "home", "waveform": [waveform], "capture": {"length": _HOMING, "down_sampling": 1}}
    drive = next((name for name, one in file.channels.items() if one.input == DRIVE), None)
    begun = time.monotonic()

    def goal(now: float, block: dict[str, NDArray[np.float64]]) -> None:
        at = block[POSITION]
        if drive is not None:
            volts = block[drive]
            at = at[np.abs(volts) < 0.03 * max(float(np.abs(volts).max()), 1.0)]
        if at.size and (float(at[-1]) <= 0.0 if position > 0 else float(at[-1]) >= 0.0):
            raise Arrived(
                f"home, to {with_prefix(float(at[-1]), unit, 2)}, after {time.monotonic() - begun:.1f} s"
            )

    shown = document.described()["channels"]
    # If the position is beyond a limit, the rig must be able to walk back. A limit is therefore moved
    # outwards at least to the present position plus one stroke of the piezo.
    cell = document.checked.cells[0]
    stroke = abs(position) + abs(cell.actuator.gain) * max(cell.limits.max_voltage, -cell.limits.min_voltage)
    limits = dict(content.get("limits", {}))
    for name, sign in (("max_position", 1.0), ("min_position", -1.0)):
        if limits.get(name) is not None and sign * position > 0.0:
            limits[name] = sign * max(sign * to_si(limits[name], unit, name), stroke)
    made = check_experiment({**content, "runs": [run], "save_as": [], "limits": limits})
    out = folder.root / ".rig" / "home"  # the recording of the walk, deleted afterwards
    remove = partial(shutil.rmtree, out, ignore_errors=True)
    return BenchJob("Home", made, folder.root, out, shown, goal=goal, finished=remove)
