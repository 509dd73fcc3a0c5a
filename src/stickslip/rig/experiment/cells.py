"""Cells of an experiment file: one for each recording, with all values resolved and checked."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..._version import __version__
from ...physics.actuator import Actuator, load_actuator
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError, to_si, unit_for
from ...recording.calibration import load_calibration
from ...recording.readers import read_recording
from ...waveform.sampled import Sampled
from ...waveform.sequence import Sequence
from ...waveform.signal import Waveform, shape
from .. import Capabilities, Capture, Channel, Limits, Repeats, RigError, Trigger
from ..measurement import channel_units, plan_run
from .file import ChannelSpec, ExperimentFile, LimitsSpec, PartSpec, RunSpec, VirtualRigSpec
from .laboratory import Laboratory, own_file

MOST_CELLS = 10_000


@dataclass(frozen=True)
class Cell:
    """Settings of one recording of an experiment, and `key`, a hash of the settings, the rig and the package
    version.

    `name` is the name of the recording and its file, `run` the name of the run in the experiment file.
    `values` are the recording's values of the matrix, by axis. For a virtual rig, `seed` is the seed of the
    noise, `repeats` the variation of the contact, and `bench` the name or path of the bench. For a real rig
    `seed` and `repeats` have no effect, and `bench` is "".
    """

    name: str
    run: str
    notes: str
    values: dict[str, float | str]
    drive: Waveform
    actuator: Actuator
    channels: dict[str, Channel]
    capture: Capture
    limits: Limits
    seed: int
    repeats: Repeats
    bench: str
    key: str


Read = Callable[[Path], Any]


def cells(
    file: ExperimentFile, folder: Path, laboratory: Laboratory, read: Read = read_recording
) -> list[Cell]:
    """Return the settings of each recording of a file, in order, after all checks. Nothing is output.

    Args:
        file: the experiment file's content.
        folder: folder of the file, for the paths in it.
        laboratory: source of the rig, asked for its capabilities only.
        read: called with the path of a recording from which a drive is taken; returns the recording.

    Raises:
        ValueError: a value is wrong, there are too many recordings, or two have the same name. The message
            names the run and the field.
        LimitError, CaptureError: the limits refuse a drive, or a trigger cannot come.
    """
    channels = {name: _channel(name, spec, folder) for name, spec in file.channels.items()}
    found: dict[str, Cell] = {}
    repeats = _repeats(file)
    for run in file.runs:
        count = run.repeats
        for values in run.matrix.values():
            count *= len(values)
        if count + len(found) > MOST_CELLS:
            raise QuantityError(f"{run.name}: the matrix has more than {MOST_CELLS} recordings")
        for axes, repeat in _asked(run):
            try:
                cell = _cell(file, run, axes, repeat, channels, folder, laboratory, read, repeats)
            except (ValueError, RigError) as error:
                shown = "".join(f", {axis} = {value}" for axis, value in axes.items())
                kind = type(error) if isinstance(error, RigError) else QuantityError
                raise kind(f"run {run.name!r}{shown}: {error}") from None
            if cell.name in found:
                raise QuantityError(f"two recordings would be called {cell.name}: give the runs other names")
            found[cell.name] = cell
            repeats = repeats._replace(number=repeats.number + int(cell.capture.average))
    return list(found.values())


def _asked(run: RunSpec) -> Iterator[tuple[dict[str, float | str], int]]:
    """Yield for each recording of a run its values of the matrix, by axis, and its repeat, counted from 1."""
    for values in itertools.product(*run.matrix.values()):
        for repeat in range(1, run.repeats + 1):
            yield dict(zip(run.matrix, values, strict=True)), repeat


def _cell(
    file: ExperimentFile,
    run: RunSpec,
    axes: dict[str, float | str],
    repeat: int,
    channels: dict[str, Channel],
    folder: Path,
    laboratory: Laboratory,
    read: Read,
    repeats: Repeats,
) -> Cell:
    name = _name(run, axes, repeat)
    seed = (repeats.series + getattr(file.rig, "first_run", 0) << 32) + zlib.crc32(name.encode())
    named = {k: v for k, v in file.variables.items() if not isinstance(v, bool)} | axes
    actuator = _actuator(file, run, named, folder)
    can = laboratory.capabilities(actuator)
    limits = limits_of(file.limits, actuator)
    units = channel_units(can, channels, limits)
    capture = _capture(run, can, units)
    drive = drive_of(run.waveform, named, folder, read)
    plan = plan_run(can, drive, channels, capture, limits)
    varied = repeats.told(actuator, int(capture.average))
    made_of = repr(
        (__version__, can, file.rig, actuator, channels, capture, limits, seed, file.variables, axes, varied)
    )
    key = hashlib.sha256(made_of.encode() + plan.volts.tobytes()).hexdigest()
    return Cell(
        name=name,
        run=run.name,
        notes=run.notes or file.notes,
        values=axes,
        drive=drive,
        actuator=actuator,
        channels=channels,
        capture=capture,
        limits=limits,
        seed=seed,
        repeats=repeats,
        bench=str(own_file(file.rig.bench, folder, ".toml")) if isinstance(file.rig, VirtualRigSpec) else "",
        key=key,
    )


def cell_names(file: ExperimentFile) -> list[str]:
    """Return the names of an experiment file's recordings, in order, without opening rig or other files.

    At most the first `MOST_CELLS` are returned; `cells` refuses more.
    """
    names = (_name(run, axes, repeat) for run in file.runs for axes, repeat in _asked(run))
    return list(itertools.islice(names, MOST_CELLS))


def _name(run: RunSpec, axes: Mapping[str, float | str], repeat: int) -> str:
    parts = [run.name, *(_in_name(value) for value in axes.values())]
    return "_".join(parts + ([str(repeat)] if run.repeats > 1 else []))


def _repeats(file: ExperimentFile) -> Repeats:
    """Return the state of the series of runs before the first run of a file, with the contact's variation.

    For a real rig there is no variation.
    """
    if not isinstance(file.rig, VirtualRigSpec):
        return Repeats()
    return Repeats(file.rig.variation, file.rig.seed, file.rig.first_run, file.rig.irregularity)


def _in_name(value: float | str) -> str:
    """Return a value of the matrix as part of a file name, such as "65V", "0.5Hz" or "-3".

    Characters other than letters, digits and ".+-" are left out; "x" is returned if nothing is left.
    """
    text = value if isinstance(value, str) else f"{value:g}"
    return re.sub(r"[^A-Za-z0-9.+-]", "", text)[:40].strip(".") or "x"


def _substituted(value: Any, axes: Mapping[str, float | str]) -> Any:
    if isinstance(value, list):
        return [_substituted(one, axes) for one in value]
    if not isinstance(value, str) or not value.startswith("$"):
        return value
    if value[1:] not in axes:
        hint = did_you_mean(value[1:], axes)
        raise QuantityError(
            f"{value} is no axis of the matrix and no variable{hint}; there are {', '.join(axes) or 'none'}"
        )
    return axes[value[1:]]


def _actuator(file: ExperimentFile, run: RunSpec, axes: Mapping[str, float | str], folder: Path) -> Actuator:
    actuator = load_actuator(own_file(file.actuator.set, folder, ".toml"))
    friction = {k: _substituted(v, axes) for k, v in file.actuator.friction.items()}
    changes = {k: _substituted(v, axes) for k, v in {**file.actuator.change, **run.change}.items()}
    if "friction" in changes or "name" in changes:
        raise QuantityError("actuator.change: friction and name are not changed there")
    return actuator.replace(friction=actuator.friction._replace(**friction), **changes)


def limits_of(spec: LimitsSpec, actuator: Actuator) -> Limits:
    """Return the limits of an experiment file.

    Voltages that the file does not give are those of the actuator, or the defaults of `Limits` if the
    actuator's are unlimited (1 MV or more). Positions may have a unit, m or rad. Raises QuantityError for a
    wrong value.
    """
    given = spec.given
    for name in {*given} & {"min_position", "max_position"}:
        given[name] = to_si(given[name], unit_for(actuator, "m"), f"limits.{name}")
    own = {"min_voltage": actuator.min_voltage, "max_voltage": actuator.max_voltage}
    return Limits(**{key: value for key, value in own.items() if abs(value) < 1e6} | given)


def _channel(name: str, spec: ChannelSpec, folder: Path) -> Channel:
    try:
        return Channel(
            spec.input,
            tuple(load_calibration(own_file(text, folder, ".json")) for text in spec.calibration),
            spec.filter,
            spec.zero,
        )
    except ValueError as error:
        raise QuantityError(f"channels.{name}: {error}") from None


def _capture(run: RunSpec, can: Capabilities, units: Mapping[str, str]) -> Capture:
    spec = run.capture
    if (spec.interval is None) == (spec.down_sampling is None):
        raise QuantityError("capture: give either interval or down_sampling")
    trigger = None
    if spec.trigger is not None:
        unit = units.get(spec.trigger.signal, "V")
        level = to_si(spec.trigger.level, unit, "capture.trigger.level")
        trigger = Trigger(level=level, **spec.trigger.given)
    interval = spec.interval if spec.interval is not None else (spec.down_sampling or 1) / can.sample_rate
    return Capture(interval=interval, trigger=trigger, **spec.given)


def drive_of(
    parts: list[PartSpec], axes: Mapping[str, float | str], folder: Path, read: Read = read_recording
) -> Waveform:
    """Return the drive of a run as a waveform, V, with one part after the other.

    Args:
        parts: parts of the drive: waveforms, or variables of recordings.
        axes: values by name; each replaces $NAME in the parts.
        folder: folder of the experiment file, for the paths in it.
        read: called with the path of a recording; returns the recording.

    Raises:
        QuantityError: a part is wrong; the message has its index, from 0.
    """
    made = []
    for i, part in enumerate(parts):
        try:
            waveform = _waveform(part, axes, folder, read)
        except ValueError as error:
            raise QuantityError(f"waveform[{i}]: {error}") from None
        made.append(waveform if part.duration is None else (waveform, _substituted(part.duration, axes)))
    if len(parts) == 1 and parts[0].duration is None:
        return made[0]
    return Sequence(*made)


def _waveform(part: PartSpec, axes: Mapping[str, float | str], folder: Path, read: Read) -> Waveform:
    if (part.shape is None) == (part.file is None):
        raise QuantityError("a part has either a shape or a file")
    if part.shape is not None:
        return shape(part.shape, folder)(**{key: _substituted(v, axes) for key, v in part.fields.items()})
    if part.fields:
        raise QuantityError("a file takes no fields")
    recording = read(folder / str(part.file))
    return Sampled.from_recording(recording, part.variable)


def variables_attribute(file: ExperimentFile, cell: Cell) -> str:
    """Return the attribute "variables" of a recording: a JSON text with the variables of the file and the
    recording's values of the matrix, which take precedence, by name."""
    return json.dumps({**file.variables, **cell.values}, ensure_ascii=False)
