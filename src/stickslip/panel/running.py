"""The current run: a job in a thread, which continues without any page until its end or a stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..quantities.progress import Progress
from ..recording.readers.process import Reader
from ..rig import HostedRig, Link, Rig, RigError, WatchedRig
from ..rig.experiment.cells import Cell
from ..rig.experiment.file import ExperimentFile
from ..rig.experiment.laboratory import Laboratory, open_laboratory, rigs_of
from ..rig.experiment.running import record_experiment
from ..rig.gate import PositionInput
from ..rig.measurement import POSITION
from ..rig.memory import collect
from ..rig.protocols import StopRequested
from ..rig.stopping import StopState, follow_stop
from .asking import Asker, asked_by, asking
from .beating import Beating
from .journal import Journal
from .live import Live
from .statistics import Statistics, drive_channel
from .stream import Hub
from .trigger import TriggerSeeker

if TYPE_CHECKING:
    import xarray as xr

_AT_ZERO = 0.5  # largest drive at the end of a run that counts as 0 V, V


class Arrived(RigError):
    """End of a run whose only purpose was to reach a position, after the position was reached."""


class BenchJob(NamedTuple):
    """An experiment to run, folder of its relative paths, folder for recordings, and channels (`columns`).

    `goal` gets the position from home [m, rad] and each block of samples by channel, and raises `Arrived` to
    end the run. A `loop`, which takes a progress callback, is run instead of the experiment. `finished` is
    called at the end.
    """

    title: str
    file: ExperimentFile
    folder: Path
    out: Path
    columns: list[dict[str, str]]
    goal: Callable[[float, dict[str, NDArray[np.float64]]], None] | None = None
    loop: Callable[[Progress], None] | None = None
    finished: Callable[[], None] | None = None


class Runner:
    """Runs one job at a time. `position` is the end-effector's last measured position, m (rad) from home. If
    the output then ramped to 0 V, `before_ramp` is True: the end-effector may have moved since.

    The rig's process owns the output and stops by itself if this process dies or stalls. A stop goes directly
    to the rig's process.

    Args:
        hub, live, journal: stream, curves and log, which receive the progress.
        rigs: folder of the process that owns the panel's virtual rig.
        read: reads the files that an experiment names.
        statistics: receives the samples; may request a stop.
    """

    def __init__(
        self, hub: Hub, live: Live, journal: Journal, rigs: Path, read: Reader, statistics: Statistics
    ) -> None:
        self._hub, self._live, self._journal, self._rigs, self._read = hub, live, journal, rigs, read
        self._statistics = statistics
        self.asks: list[Callable[[], None]] = []  # called before a job starts; an error refuses the job
        self.also_stop: list[Callable[[], bool]] = []  # stop other activities; True if one was active
        self.beating = Beating()  # passes heartbeats of the page in control on
        self._control: Link | None = None
        self._stopper: Link | None = None  # a stop uses this link, to wait for no other answer
        self._linking = threading.Lock()
        self._using = threading.Lock()  # lock of the rig: held during a run, and while home is set
        self._delivered = 0.0  # time until the rig's process confirmed the stop, s
        self._telling = threading.RLock()  # guards `state`: the run and requests change it
        self._thread: threading.Thread | None = None
        # Reason and time of a stop: as sent to the rig's process at once, and as known to pages.
        self._sent: tuple[str, float] | None = None
        self._stop: tuple[str, float] | None = None
        self._told = 0.0
        self._busy = False
        self.position = 0.0
        self.before_ramp = False
        self._moved, self._volts = False, 0.0  # position measured in this job? last drive voltage, V
        self.state: dict[str, Any] = {"number": 0, "phase": "idle", "title": "", "doing": ""}
        self.state |= {"done": 0.0, "remaining": None, "stop": None}

    @property
    def where(self) -> dict[str, Any]:
        """Return "position" and "before_ramp", as pages receive them."""
        return {"position": self.position, "before_ramp": self.before_ramp}

    @property
    def busy(self) -> bool:
        """Return True while a job is running."""
        return self._busy

    def start(self, job: BenchJob) -> None:
        """Start a job in a thread; raises RigError while another runs, or the error of a function in
        `asks`."""
        if not self.busy:
            for ask in self.asks:
                ask()
        with self._telling:
            if self.busy:
                raise RigError("a run is going on: stop it first")
            self._sent, self._stop, self._busy = None, None, True
            self._moved, self._volts = False, 0.0
            self._thread = threading.Thread(target=self._run, args=(job, asking()), name="rig", daemon=False)
            number = self.state["number"] + 1
            self._state(
                number=number,
                phase="preparing",
                title=job.title,
                doing="checking",
                done=0.0,
                remaining=None,
                stop=None,
            )
            self._thread.start()

    def stop(self, why: str) -> bool:
        """End a run (ramp to 0 V) and a sequence for the reason `why`; return False if neither was active."""
        asked, stopper = time.perf_counter(), self._stopper
        told = stopper is not None and self._busy and self._stop is None
        if stopper is not None and told:  # the stop is sent first: what follows is slower
            self._sent = why, asked
            with suppress(RigError):
                stopper.tell_stop(why)
                threading.Thread(target=self._halt, args=(stopper, asked), daemon=True).start()
        also = [act() for act in self.also_stop]
        with self._telling:
            if not self.busy:
                return any(also)
            if self._stop is not None:
                return True
            self._stop = (why, asked)
            self._state(phase="stopping", stop=StopState()._asdict())
            asker = asking()
            number = self.state["number"]
            threading.Thread(target=self._follow, args=(*self._stop, number), daemon=True).start()
            threading.Thread(target=self._tell_stop, args=(asker, why), daemon=True).start()
        return True

    def _tell_stop(self, asker: Asker, why: str) -> None:
        """Log the stop in a thread, because a stop must not wait for a disk."""
        with asked_by(asker):
            self._journal(f"{why}: asked for", "warning")

    def _halt(self, stopper: Link, asked: float) -> None:
        """Note the time from `asked` [s] until the rig's process confirms the stop; it may never do so."""
        with suppress(RigError):
            stopper.heard_stop()
            self._delivered = time.perf_counter() - asked

    def _follow(self, why: str, asked: float, number: int) -> None:
        """Repeat a stop of run `number`, requested at `asked` s, through other links until 0 V; show it."""
        control = self._control
        if control is None:
            return  # the rig was not reached yet: the run itself will check for a stop
        alarm = ""

        def tell(stop: StopState) -> None:
            nonlocal alarm
            with self._telling:
                if self.state["number"] == number:
                    self._state(stop=stop._asdict())
            if stop.alarm and stop.alarm != alarm:
                self._journal(stop.alarm, "error")
            elif alarm and not stop.alarm:
                self._journal(f"the rig answers again: {stop.state}", "warning")
            alarm = stop.alarm

        follow_stop(control.folder, why, tell, lambda: self.busy and self.state["number"] == number, asked)

    def reach(self, folder: Path | None = None) -> Link:
        """Return a connection to the rig's process in `folder` (None: virtual rig); runs do not use it.

        The process is started if needed. The connection is kept for later calls; one to another folder, or
        one that does not answer, is closed.
        """
        folder = folder or self._rigs
        with self._linking:
            if self._control is not None:
                try:
                    if self._control.folder == folder:
                        self._control.ask("state")
                        return self._control
                except RigError:
                    pass
                self.close()
            self._control, self._stopper = Link(folder, "the panel"), Link(folder, "a stop of the panel")
            return self._control

    def find_position(self) -> None:
        """Ask the virtual rig's process for the end-effector's position, and show it; nothing during a
        run."""
        if not self.busy:
            position = self.reach().ask("state")[0]["position"]
            if position is not None:
                self.position = position
                self._state()

    def close(self) -> None:
        """Close the connections to the rig's process."""
        links = self._control, self._stopper
        self._control = self._stopper = None
        for link in links:
            if link is not None:
                link.close()

    def join(self, most: float | None = None) -> None:
        """Wait for the end of the run, at most `most` seconds."""
        if self._thread is not None:
            self._thread.join(most)

    def home_here(self, file: ExperimentFile, folder: Path, cell: Cell) -> None:
        """Set home to the position that `cell` measures in a run at 0 V; RigError without such a channel."""
        channel = cell.channels.get(POSITION)
        if channel is None:
            raise RigError(f"home is set by the channel {POSITION}, which is not recorded")
        with self._using:
            laboratory = open_laboratory(file, folder, self._rigs, "the panel")
            try:
                rig = laboratory.rig(cell.actuator, cell.seed)
                if isinstance(rig, HostedRig):
                    rig.home_here(PositionInput(channel.input, channel.calibration), cell.limits.stop_slew)
            finally:
                laboratory.close()
        self.position, self.before_ramp = 0.0, False
        self._state()

    def _run(self, job: BenchJob, asker: Asker) -> None:
        with asked_by(asker):
            self._journal(f"{job.title}: started")
        phase, ramped = "failed", True
        try:
            with self._using:
                link = self.reach(rigs_of(job.file, self._rigs, job.folder))
                self.beating.follow(link.folder, lambda: self._busy)
                recorded = self._recorded(job, partial(self._progress, time.monotonic()))
            self._journal(f"{job.title}: finished, {_counted(recorded)} in {job.out.name}")
            phase, ramped = "done", abs(self._volts) > _AT_ZERO
        except Arrived as arrived:
            self._journal(f"{job.title}: {arrived}")
            phase = "done"
        except StopRequested as stopped:
            self._journal(f"{job.title}: {stopped}; what was finished is kept", "warning")
            phase = "stopped"
        except Exception as error:
            known = isinstance(error, ValueError | OSError | RigError | MemoryError)
            said = str(error) if known else f"unexpected {type(error).__name__}"
            self._journal(f"{job.title}: {said}", "error")
        finally:
            with ExitStack() as last:
                last.callback(self._ended, phase, ramped)  # called whatever fails before
                self._live.end()
                self._statistics.end(self.position)
                if job.finished is not None:
                    self._finish(job.finished)
                collect()

    def _ended(self, phase: str, ramped: bool) -> None:
        if self._moved:
            self.before_ramp = ramped
        with self._telling:
            self._busy = False  # before pages hear of the end: one may start a run at once
            self._state(phase=phase, doing="", done=float(phase == "done"), remaining=None)

    def _recorded(self, job: BenchJob, progress: Progress) -> int:
        """Run the job; return the number of its recordings (1 for a loop)."""
        if job.loop is not None:
            job.loop(progress)
            return 1
        watch = partial(self._watched, job)
        own: dict[str, Any] = {"label": job.title, "watch": watch, "read": self._read}
        made = record_experiment(
            job.file,
            job.folder,
            job.out,
            progress,
            self._has_recording,
            opened=partial(open_laboratory, rigs=self._rigs, who="the panel"),
            **own,
        )
        return len(made)

    def _has_recording(self, cell: Cell, recording: xr.Dataset) -> None:
        self._live.recorded({str(name): float(one[-1]) for name, one in recording.data_vars.items()})

    def laboratory(self, job: BenchJob) -> Laboratory:
        """Open the rig of a job, by connecting to its process; the caller must close the result."""
        return open_laboratory(job.file, job.folder, self._rigs, "the panel")

    def need_going(self) -> None:
        """Raise StopRequested if a stop was requested; a job calls this before its next action."""
        if self._stop is not None:
            raise StopRequested(self._stop[0])

    def seen(self, position: float) -> None:
        """Take the position that a running loop has measured, m (rad) from home; pages show "running"."""
        self._at(position)
        self._puts_out()

    def _puts_out(self) -> None:
        with self._telling:
            if self.state["phase"] == "preparing":
                self._state(phase="running")

    def _at(self, position: float) -> None:
        self.position, self.before_ramp, self._moved = position, False, True

    def _finish(self, finished: Callable[[], None]) -> None:
        try:
            finished()
        except (ValueError, OSError) as error:  # an error here must not prevent the next run
            self._journal(f"after the run: {error}", "error")

    def _watched(self, job: BenchJob, cell: Cell, rig: Rig) -> Rig:
        rate = rig.capabilities.sample_rate
        if isinstance(rig, HostedRig):
            rig.operated = True
        seek = TriggerSeeker(cell.capture, self._live)
        drive = drive_channel(cell.channels)

        def armed(samples: int, before: int) -> None:
            pre_trigger = cell.capture.before * cell.capture.interval
            self._live.begin(f"{job.title}: {cell.name}", job.columns, rate, samples, before, pre_trigger)
            seek.begin(before)
            self._statistics.begin(job.columns, drive)
            with self._telling:
                # A virtual rig computes a run before its output starts; a requested stop prevents both.
                self._state(phase="preparing" if self._stop is None else "stopping", doing=cell.name)

        def sees(block: dict[str, NDArray[np.float64]]) -> None:
            self.need_going()
            if not any(one.size for one in block.values()):
                return
            self._puts_out()
            seek(block)
            began = getattr(rig, "began", None)
            if POSITION in block and began is not None:
                if cell.channels[POSITION].zero:
                    block = {**block, POSITION: block[POSITION] + began}
                self._at(getattr(rig, "position", self.position))
            if drive in block and block[drive].size:
                self._volts = float(block[drive][-1])
            self._live.add(block)
            why = self._statistics.add(block, self.position)
            if why:
                self.stop(why)
            if job.goal is not None:
                job.goal(self.position, block)

        def stopping() -> None:
            after = getattr(rig, "ramp_after", None)
            if sent := self._stop or self._sent:
                said = "before anything was put out"
                if after is not None and self._live.begun:
                    waited = 1e3 * (after + self._delivered)
                    said = f"ramp to 0 V began {waited:.1f} ms after the request"
                self._journal(f"{sent[0]}: {said}", "warning")

        return WatchedRig(rig, cell.channels, armed, sees, stopping)

    def _progress(self, begun: float, doing: str, done: float) -> None:
        now = time.monotonic()
        if now - self._told < 0.1 and doing == self.state["doing"]:
            return
        self._told = now
        # No estimate at first: a run may have to be computed before it starts.
        remaining = (now - begun) * (1.0 - done) / done if done > 0.02 else None
        self._state(doing=doing, done=done, remaining=remaining)

    def _state(self, **changes: Any) -> None:
        with self._telling:
            self.state = {**self.state, **changes}
            self._hub.tell("run", **self.state, **self.where)


def _counted(count: int) -> str:
    return f"{count} recording{'s' if count != 1 else ''}"
