"""Moves of the rig on the bench in closed loop: the loop runs in the rig's process and follows commands."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..control import (
    LowPass,
    Pid,
    Regulator,
    Stepping,
    StepSizes,
    Tuning,
    check_margins,
    commanded,
    plausibility,
    tune,
)
from ..control.commanded import HEARTBEAT
from ..control.loops import Loop, sampled_loop, step_response
from ..control.tuning import margins, models_of
from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.input_file import Strict, fields_of
from ..quantities.progress import Progress
from ..quantities.records import quantities
from ..quantities.units import QuantityError, coordinate_of, unit_for, with_prefix
from ..recording.readers.process import Reader
from ..rig import Capabilities, Channel, HostedRig, Plausibility, RigError, regulate
from ..rig.experiment.cells import Cell, cells
from ..rig.experiment.file import ExperimentFile
from ..rig.experiment.laboratory import PlanningLaboratory
from ..rig.experiment.running import check_experiment
from ..rig.limits import check_edges
from ..rig.measurement import DRIVE, POSITION
from .control import Control
from .document import BenchDocument
from .folder import Folder
from .journal import Journal
from .live import Live
from .running import BenchJob, Runner
from .sliders import settings
from .starting import Starter, counted_on, new_folder
from .stream import Client, Hub, Message

AT_MOST = 120.0  # longest time of a session, s
_INTERVAL = 0.25e-3  # sampling interval of the recording, s
_TOLD = 0.05  # shortest time between two messages on position and target, s
_SPREAD = 0.05  # relative change of the natural frequency, up and down, for which margins are kept
_SHOWN = 0.03  # duration of a predicted step response, s
COLUMNS = {"drive_voltage": "drive", POSITION: "end-effector", "target_position": "target"}
SETTINGS = ("amplitude", "frequency", "tolerance")  # fields of `Stepping` that the page shows


class LoopSettings(fields_of(Stepping, *SETTINGS)):
    """Settings of the control loop, and some fields of `control.Stepping`.

    `input` is the input with the position sensor, "" for the first. `bandwidth` [Hz], the integral gain times
    the piezo's gain over 2 pi, and `corner` [Hz] of the low-pass filter keep the tuned value if null.
    `proportional` is the proportional gain times the piezo's gain.
    """

    input: str = ""
    bandwidth: float | None = None
    proportional: float = 0.0
    corner: float | None = None


class Act(Strict):
    """A command `what`, as for `control.Commanded.command`, and settings of the session that it may start."""

    what: dict[str, Any]
    settings: LoopSettings = Field(default_factory=LoopSettings)


class Prepared(NamedTuple):
    """First run on the bench (`content`, `file`, `cell`), its rig (`can`, `output`), and the tuned loop.

    Voltages are limited to `low`..`high` [V]. `others` are the actuator with its natural frequency lowered
    and raised by `_SPREAD`; the loop is stable for them, too. `loops` are discrete models of all of them.
    """

    content: dict[str, Any]
    file: ExperimentFile
    cell: Cell
    can: Capabilities
    output: OutputStage
    low: float
    high: float
    tuning: Tuning
    loops: Sequence[Loop]
    others: Sequence[Actuator]

    @property
    def unit(self) -> str:
        """Return the unit of positions: m, or rad for rotary actuators."""
        return unit_for(self.cell.actuator, "m")

    @property
    def amplitude(self) -> float:
        """Return the initial amplitude of full steps on the page, V."""
        return min(Stepping().amplitude, self.high - self.low)

    @property
    def sensors(self) -> list[str]:
        """Return the names of the rig's inputs that measure in `unit`."""
        return [name for name, unit in self.can.inputs.items() if unit == self.unit]

    @property
    def columns(self) -> list[dict[str, str]]:
        """Return name, unit and label of each recorded channel, see `COLUMNS`."""
        units = {"drive_voltage": "V"}
        return [
            {"name": name, "unit": units.get(name, self.unit), "label": label}
            for name, label in COLUMNS.items()
        ]

    def regulator(self, asked: LoopSettings) -> Regulator:
        """Return the regulator with the values in `asked`, and tuned ones for those that are null."""
        own = self.tuning
        gain, integral = self.cell.actuator.gain, own.pid.integral
        if asked.bandwidth is not None:
            integral = 2.0 * math.pi * asked.bandwidth / gain
        pid = Pid(integral, asked.proportional / gain)
        low_pass = own.low_pass if asked.corner is None else LowPass(asked.corner)
        options: dict[str, Any] = {"notches": own.notches, "low_pass": low_pass, "lead": own.lag}
        options |= {"min_voltage": self.low, "max_voltage": self.high}
        return Regulator(pid, self.can.update_rate, feedforward=own.feedforward, **options)


def _range(tuned: float, low: float, high: float) -> dict[str, float]:
    return {"tuned": float(f"{tuned:.4g}"), "low": low, "high": high}


class Moves:
    """Moves of the rig on the bench. A session lasts from the first command to a release, a stop, the loss of
    the page in control, or `AT_MOST`."""

    def __init__(
        self,
        folder: Folder,
        hub: Hub,
        control: Control,
        journal: Journal,
        document: BenchDocument,
        runner: Runner,
        live: Live,
        starter: Starter,
        read: Reader,
    ) -> None:
        self._folder, self._hub, self._journal, self._document = folder, hub, journal, document
        self._runner, self._live, self._starter, self._read = runner, live, starter, read
        self._lock, self._preparing = threading.Lock(), threading.Lock()
        self._known: tuple[str, Prepared] | None = None
        self._tables: dict[str, StepSizes] = {}
        self._rig: HostedRig | None = None  # rig of the active session
        self._first: dict[str, Any] | None = None  # command that starts the session
        self.state: dict[str, Any] = {"on": False}
        self._told = self._jogged = 0.0
        hub.greetings.append(self._greet)
        control.gone.append(self._left)

    def prepared(self) -> Prepared:
        """Return the first run on the bench and its tuned loop; they are kept until the experiment changes.

        Raises ValueError if no loop can be closed (low margins, clamped actuator), RigError if the rig does
        not answer.
        """
        content = self._document.checked.content
        content = {**content, "runs": content["runs"][:1]}
        key = json.dumps(content, sort_keys=True, default=str)
        with self._preparing:
            if self._known is None or self._known[0] != key:
                self._known = key, self._prepare(content)
            return self._known[1]

    def _prepare(self, content: dict[str, Any]) -> Prepared:
        file = check_experiment(content)
        laboratory = PlanningLaboratory(file, self._folder.root)
        cell = cells(file, self._folder.root, laboratory, self._read)[0]
        can, limits, model = laboratory.capabilities(cell.actuator), cell.limits, cell.actuator
        check_edges(limits, can)
        ends = [model.natural_frequency * (1.0 + sign * _SPREAD) for sign in (-1, 1)]
        others = [model.replace(natural_frequency=one) for one in ends]
        output = laboratory.output()
        tuning = tune(model, output, posterior=others)
        loops = [sampled_loop(one, output) for one in models_of(model, others)]
        low, high = max(limits.min_voltage, can.min_voltage), min(limits.max_voltage, can.max_voltage)
        return Prepared(content, file, cell, can, output, low, high, tuning, loops, others)

    def choices(self) -> dict[str, Any]:
        """Return the fields of the page: actuator, unit, inputs (sensors), voltage (smallest and largest
        amplitude of steps), settings; "tuned", "low", "high" of bandwidth, proportional and corner; stroke,
        plausibility, at_most [s]."""
        made = self.prepared()
        own, model, rate = made.tuning, made.cell.actuator, made.can.update_rate
        sensors, known = made.sensors, made.cell.channels.get(POSITION)
        return {
            "actuator": model.name,
            "unit": made.unit,
            "inputs": [*sensors, *([] if known is None or known.input in sensors else [known.input])],
            "voltage": [0.2 * (made.high - made.low), made.high - made.low],
            "settings": settings(Stepping(amplitude=made.amplitude), SETTINGS, coordinate_of(made.unit)),
            "bandwidth": _range(model.gain * own.pid.integral / (2.0 * math.pi), 1.0, 0.1 * rate),
            "proportional": _range(0.0, 0.0, 1.0),
            "corner": _range(0.45 * rate if own.low_pass is None else own.low_pass.corner, 20.0, 0.45 * rate),
            "stroke": model.gain * (made.high - made.low),
            "at_most": AT_MOST,
            "plausibility": self._believed(made),
        }

    def _believed(self, made: Prepared) -> list[dict[str, Any]]:
        """Return name, value as text with unit, and meaning of each threshold of `Plausibility`."""
        beliefs, rows = self._plausibility(made, Stepping().frequency), []
        for name, quantity in quantities(Plausibility).items():
            own = quantity.along(coordinate_of(made.unit))
            value = getattr(beliefs, name)
            rows.append({"name": name, "value": with_prefix(value, own.unit), "meaning": own.meaning})
        return rows

    def _plausibility(self, made: Prepared, frequency: float) -> Plausibility:
        span, table = made.high - made.low, self._table(made, frequency)
        return plausibility(made.cell.actuator, made.output, frequency, span, table=table)

    def response(self, asked: LoopSettings) -> tuple[dict[str, Any], dict[str, NDArray[np.float64]]]:
        """Return "margins" of the loop and "refused" (why they are too low, or ""), and responses to a unit
        step.

        The responses are arrays [ticks] over "time" [s], cut to -3..5: "model" is that of the actuator; "low"
        and "high" are the lowest and highest of the actuator and the models with other natural frequencies.
        """
        made = self.prepared()
        regulator, rate = made.regulator(asked), made.can.update_rate
        ticks = round(_SHOWN * rate)
        found = [np.clip(step_response(regulator, one, ticks), -3.0, 5.0) for one in made.loops]
        refused = ""
        try:
            check_margins(regulator, made.cell.actuator, posterior=made.others, output=made.output)
        except ValueError as error:
            refused = str(error)
        said = {"margins": margins(regulator, made.loops).report(), "refused": refused}
        return said, {
            "time": np.arange(ticks) / rate,
            "model": found[0],
            "low": np.min(found, axis=0),
            "high": np.max(found, axis=0),
        }

    def act(self, asked: Act) -> None:
        """Execute a command. Without a session "go", "steps" or "jog" starts one, and "halt" does nothing. A
        command refused with a ValueError or RigError puts nothing out."""
        do = asked.what.get("do")
        with self._lock:
            self._jogged = time.monotonic() if do == "jog" else self._jogged
            if self._rig is not None:
                self._rig.command(**asked.what)
                return
            if self._first is not None and do in ("jog", "halt") and self._runner.busy:
                self._first = asked.what  # the session is starting: only the last command counts
                return
            if do == "halt":
                return  # the session has ended already
            if do not in ("go", "steps", "jog"):
                raise QuantityError("nothing holds: go somewhere first")
            self._starter.need_free()
            self._begin(asked)

    def _begin(self, asked: Act) -> None:
        made, settings = self.prepared(), asked.settings
        regulator, cell = made.regulator(settings), made.cell
        check_margins(regulator, cell.actuator, posterior=made.others, output=made.output)
        walk = Stepping(**{"amplitude": made.amplitude, "rotary": made.unit == "rad", **settings.given})
        spec = commanded(
            *(walk, self._table(made, walk.frequency), regulator),
            *(cell.actuator.gain, made.can.step),
            unit=made.unit,
        )
        spec.made().command(**asked.what)  # refuses a wrong command before any output
        position = self._position(made, settings.input)
        content = counted_on(made.content, self._folder.root)
        out = new_folder(self._folder, "move")
        file = check_experiment(content)
        job = BenchJob("Move", file, self._folder.root, out, made.columns)

        beliefs = self._plausibility(made, walk.frequency)

        def loop(progress: Progress) -> None:
            self._run(job, made, spec, position, beliefs, progress)

        def finished() -> None:
            self._rig, self.state = None, {**self.state, "on": False}
            self._hub.tell("move", **self.state)
            self._hub.tell("recordings")

        self._first = asked.what
        try:
            self._runner.start(job._replace(loop=loop, finished=finished))
        except RigError:
            out.rmdir()
            raise

    def _table(self, made: Prepared, frequency: float) -> StepSizes:
        model = made.cell.actuator.replace(piezo=None)
        key = repr((model, made.output, frequency, made.high, made.low))
        if key not in self._tables:
            self._tables = {key: StepSizes.of_model(model, made.output, frequency, made.high - made.low)}
        return self._tables[key]

    def _position(self, made: Prepared, name: str) -> Channel:
        """Return the position sensor `name` ("" for the first), calibrated if the experiment says how. Raises
        QuantityError for another name."""
        own, sensors = made.cell.channels.get(POSITION), made.sensors
        name = name or (sensors or [own.input if own else ""])[0]
        if own is not None and own.input == name:
            return Channel(name, own.calibration)
        if name not in sensors:
            raise QuantityError(f"there is no input {name!r:.40} that shows the position in {made.unit}")
        return Channel(name)

    def _run(
        self,
        job: BenchJob,
        made: Prepared,
        spec: Any,
        position: Channel,
        beliefs: Plausibility,
        progress: Progress,
    ) -> None:
        laboratory = self._runner.laboratory(job)
        rate = made.can.sample_rate
        try:
            cell = cells(job.file, job.folder, laboratory, self._read)[0]
            rig = laboratory.rig(cell.actuator, cell.seed, cell.repeats)
            if not isinstance(rig, HostedRig):
                raise RigError("moves need a rig in a process of its own")
            rig.waiting, rig.operated = self._runner.need_going, True
            self._live.begin("Move", made.columns, rate, round(AT_MOST * rate), 0)
            regulate(
                *(rig, spec, 0.0, {"drive_voltage": Channel(DRIVE), POSITION: position}),
                *(cell.limits._replace(max_duty=1.0), AT_MOST),
                interval=round(_INTERVAL * rate) / rate,
                title="Move",
                attributes={
                    "operator": job.file.operator,
                    "epoch": datetime.now(UTC).isoformat(timespec="seconds"),
                    "actuator": repr(cell.actuator),
                    "controller": json.dumps(spec.options),
                },
                progress=progress,
                save=job.out / "move.nc",
                sees=lambda block: self._sees(rig, block),
                plausibility=beliefs,
            )
        finally:
            laboratory.close()

    def _sees(self, rig: HostedRig, block: dict[str, NDArray[np.float64]]) -> None:
        self._runner.need_going()
        first, self._first = self._first, None
        if first is not None:
            self._rig = rig
            if first.get("do") == "jog" and time.monotonic() - self._jogged > HEARTBEAT:
                first = {"do": "halt"}  # the jog button was released meanwhile
            rig.command(**first)
        self._live.add({name: block[name] for name in COLUMNS})
        position = float(block[POSITION][-1])
        self._runner.seen(position)
        now = time.monotonic()
        if now - self._told > _TOLD:
            self._told = now
            target = float(block["target_position"][-1])
            self.state = {"on": True, "position": position, "target": target, **rig.said()}
            self._hub.tell("move", **self.state)

    def _greet(self, client: Client, said: dict[str, Any]) -> Iterable[Message]:
        yield json.dumps({"kind": "move", **self.state})

    def _left(self) -> None:
        """Release the loop when the page in control is lost, in a thread: the event loop must not wait."""
        if self._rig is not None:
            threading.Thread(target=self._let_go, args=(self._rig,), daemon=True).start()

    def _let_go(self, rig: HostedRig) -> None:
        self._journal("Move: who was in control has left: the output goes to 0 V", "warning")
        try:
            rig.command(do="release")
        except (RigError, ValueError):
            if self._rig is rig:  # the loop that the next page has started goes on
                self._runner.stop("who was in control has left")
