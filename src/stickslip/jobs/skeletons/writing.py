"""New input files from templates, filled in with data from the user's recordings."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError
from ...recording.replacing import replaced_whole
from ...recording.shown_drive import flow
from ...waveform.shapes import Step
from .entries import MOVED, Inspected, angles, entry_of, listed, looked_at, shown_value
from .examples import example_files, write_examples
from .measured import LOOPS, PIEZO, STAGE, WALK, loops, measured_kind, piezo

_TEMPLATES = Path(__file__).parent / "templates"
_TICK = 50e-6  # update interval of the virtual rig, s; sampling intervals are multiples of it
_STROKE = 0.1057e-6  # gain of the parameter set kang2007, whose values the other initial values follow, m/V
_IN_PROPORTION = "the friction that is found is in proportion to it"
MOST_RUN = 10.0  # longest run in a new experiment file, s, even if the recording is longer


class _Kind(NamedTuple):
    """Kind of a new file.

    `file` is its usual name, `template` the file that it is made from, `recorded` is True if it needs
    recordings, and `command` is the command that runs it, with {} for its name.
    """

    file: str
    template: str
    recorded: bool
    command: str


KINDS = {
    "campaign": _Kind("campaign.yaml", "campaign.yaml", True, "stickslip campaign {}"),
    "identification": _Kind("identification.yaml", "identification.yaml", True, "stickslip identify {}"),
    "experiment": _Kind("experiment.yaml", "experiment.yaml", False, "stickslip record {}"),
    "design": _Kind("design.yaml", "design.yaml", False, "stickslip design {}"),
    "actuator": _Kind(
        "my_actuator.toml", "actuator.toml", False,
        'stickslip simulate {} --amplitude "65 V" --frequency "5 Hz" --periods 4',
    ),
    "law": _Kind(
        "my_law.py", "law.py.txt", False,
        'stickslip simulate kang2007 --law {}:MyLaw --waveform step --amplitude "65 V" --duration "20 ms"',
    ),
    "waveform": _Kind(
        "my_waveform.py", "waveform.py.txt", False,
        'stickslip simulate --waveform {}:MyWaveform --amplitude "65 V" --frequency "5 Hz" --periods 4',
    ),
}  # fmt: skip


class New(NamedTuple):
    """Result of `new_file`.

    `files` are the written files: the new file, then example recordings. `command` runs the new file.
    `missing` are sentences on what the user must still add.
    """

    files: tuple[Path, ...]
    command: str
    missing: tuple[str, ...]


def new_file(
    kind: str, recordings: Sequence[str | os.PathLike[str]] = (), out: str | os.PathLike[str] | None = None
) -> New:
    """Write a new input file with comments, which runs without changes if nothing is missing.

    Args:
        kind: one of `KINDS`.
        recordings: the user's files, as for `inspect_file`, whose columns, units and drives are filled in.
            Without recordings, simulated ones are written beside a campaign or an identification.
        out: path of the new file; by default the usual name in the current folder.

    Returns:
        The written files, the command that runs the new file, and what is missing.

    Raises:
        QuantityError: there is no such kind, it takes no recordings or (an actuator) none of angles, or `out`
            has another ending than it.
        RecordingError: a recording cannot be read.
        FileExistsError: a file exists already; then nothing is written.
        OSError: a file cannot be written; then no file is left.
    """
    if kind not in KINDS:
        raise QuantityError(
            f"there is no kind {kind!r}{did_you_mean(kind, KINDS)}; there are {', '.join(KINDS)}"
        )
    known = KINDS[kind]
    if recordings and kind in ("design", "law", "waveform"):
        raise QuantityError(f"a {kind} is not made from recordings")
    target = Path(known.file if out is None else out)
    if target.suffix != Path(known.file).suffix:
        raise QuantityError(f"{target}: the name of a file of this kind ends in {Path(known.file).suffix}")
    made_up = known.recorded and not recordings
    examples = example_files(target, kind == "campaign") if made_up else []
    for file in (target, *examples):
        if file.exists():
            raise FileExistsError(
                17, "it is there already, and nothing is overwritten; --out names another", str(file)
            )
    seen = [looked_at(Path(file)) for file in recordings]
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        if made_up:
            seen = [looked_at(file) for file in write_examples(target, kind == "campaign")]
        own = measured_kind(seen) if kind == WALK else kind
        fields, missing = _FILLED.get(own, lambda seen, folder: ({}, []))(seen, target.parent)
        template = known.template if own == kind else f"{own}.yaml"
        text = Template((_TEMPLATES / template).read_text(encoding="utf-8"))
        with replaced_whole(target) as temporary:
            temporary.write_text(text.substitute(name=target.name, **fields), encoding="utf-8")
    except BaseException:
        for file in examples:
            # Examples that were left would make the next call fail.
            file.unlink(missing_ok=True)
        raise
    return New((target, *examples), known.command.format(target), tuple(missing))


def _identified(seen: list[Inspected], folder: Path, steps: bool) -> tuple[dict[str, str], list[str]]:
    """Return the fields of the template of a campaign or an identification, and sentences on missing data.

    Args:
        seen: the user's recordings, or the simulated examples.
        folder: folder of the new file, to which their paths are relative.
        steps: True for a campaign, which has clamped steps, and waveforms in the entries of its recordings.
    """
    lines, missing, fitted = [], [], False
    for one in seen:
        step = steps and isinstance(one.drive, Step) and len(seen) > 1
        use = "step" if step else "verify" if fitted else "fit"
        fitted = fitted or not step
        entry, lacking = entry_of(one, folder, use)
        entry += [one.waveform] if steps and one.waveform else []
        lines.append(listed(entry))
        missing += lacking
    # If all recordings are steps, the last one is taken as a walk, because a fit needs one.
    if not fitted:
        lines[-1] = lines[-1].replace("use: step", "use: fit")
    gain, source = _gain(seen)
    missing += [source] if source and gain is None else []
    start = _turning(gain, source) if angles(seen) else _sliding(gain, source)
    return {"recordings": "\n".join(lines), **start, "model": "kang2007"}, missing


def _sliding(gain: float | None, source: str) -> dict[str, str]:
    """Return the initial values of a fit for a linear actuator, as texts that fill the template, by field.

    Args:
        gain: measured gain, m/V; None: unknown.
        source: origin of the gain, or the reason why it is unknown.
    """
    known = f"  gain: {shown_value(gain, 'm/V')} # {source}" if gain else ""
    return {
        "gain": known or f"  # gain: 0.1 um/V # {source or 'stroke of the piezo per volt'}",
        "masses": "  # stage_mass: 100 g # effective, of piezo and stage\n"
        f"  # end_effector_mass: 100 g # the mass that moves; {_IN_PROPORTION}",
        "friction": "{sigma_0: 1 N/um, sigma_1: 30 N s/m, coulomb_force: 0.8 N, stiction_force: 0.8 N}",
        "noise": "20 nm",
        "force": "N",
        "unit": "m",
    }


def _turning(gain: float | None, source: str) -> dict[str, str]:
    """Return the initial values of a fit for a rotary actuator, as texts that fill the template, by field.

    They are the linear values, converted with the radius at which the stroke of the linear stage would give
    the measured angle (10 mm, if the gain is unknown).

    Args:
        gain: measured gain, rad/V; None: unknown.
        source: origin of the gain, or the reason why it is unknown.
    """
    radius = float(f"{_STROKE / gain:.2g}") if gain else 10e-3
    inertia = f"{0.1 * radius**2:.3g} kg m^2 # "
    of = f"100 g on a radius of {1e3 * radius:g} mm: write yours"
    force = f"{0.8 * radius:.3g} N m"
    known = (
        f"gain: {shown_value(gain or _STROKE / radius, 'rad/V')} # {source or 'angle of the piezo per volt'}"
    )
    return {
        "gain": f"  rotary: true # the recordings are of an angle\n  {known}",
        "masses": f"  stage_mass: {inertia}moment of inertia of piezo and stage; {of}\n"
        f"  end_effector_mass: {inertia}of what moves; {_IN_PROPORTION}; {of}",
        "friction": f"{{sigma_0: {1e6 * radius**2:.3g} N m/rad, sigma_1: {30 * radius**2:.3g} N m s/rad, "
        f"coulomb_force: {force}, stiction_force: {force}}}",
        "noise": "1 urad",
        "force": "N m",
        "unit": "rad",
    }


def _gain(seen: list[Inspected]) -> tuple[float | None, str]:
    """Return the gain of the piezo [m/V or rad/V] and its source, as text.

    The gain is displacement over voltage, from a recording of the stage or of a step with the end-effector
    clamped. If the position falls with rising voltage, the gain is None and the text is the remedy. If no
    recording shows the gain, the result is None and "".
    """
    for one in seen:
        recording: Any = one.found.recording
        shown = next((name for name in STAGE if name in recording), None)
        if shown is None and isinstance(one.drive, Step) and MOVED in recording and len(seen) > 1:
            shown = MOVED
        begins = one.found.drive_begins
        if shown is None or begins is None:
            continue
        before, after = recording["time"].values < begins, recording["time"].values > begins
        volts, moved = recording["drive_voltage"].values, recording[shown].values
        if isinstance(one.drive, Step):
            late = recording["time"].values > begins + 0.5 * (recording["time"].values[-1] - begins)
            rise = (moved[late].mean() - moved[before].mean()) / (volts[late].mean() - volts[before].mean())
        else:
            rise = float(moved[after].max() - moved[after].min()) / float(
                volts[after].max() - volts[after].min()
            )
        if math.isfinite(rise) and rise > 0:
            return float(rise), f"{one.found.path.name}: {shown} over drive_voltage"
        if rise < 0:
            unit = next((c["unit"] for c in one.found.columns if c["name"] == one.found.named.get(shown)), "")
            unit = one.found.units.get(shown) or unit or recording[shown].attrs["units"]
            turned = f'{{{shown}: "-1 {unit}"}}'
            return None, (
                f"{one.found.path.name}: {shown} goes down where drive_voltage goes up: the sensor is "
                f"inverted; say so in each file of it, units: {turned}"
            )
    return None, ""


def _voltages(seen: list[Inspected]) -> tuple[float, float, str]:
    """Return the least and greatest voltage of the drives, rounded outwards to 10 V, and the source as text.

    Without drives they are 0 V, 100 V and "". An excess of up to 1 % of the range, such as noise, is ignored.
    """
    recordings: list[Any] = [one.found.recording for one in seen]
    drives = [one["drive_voltage"].values for one in recordings if "drive_voltage" in one]
    if not drives:
        return 0.0, 100.0, ""
    low, high = min(float(d.min()) for d in drives), max(float(d.max()) for d in drives)
    span = high - low
    return (
        10.0 * math.floor((low + 0.01 * span) / 10.0),
        10.0 * math.ceil((high - 0.01 * span) / 10.0),
        "what the recordings reach",
    )


def _campaign(seen: list[Inspected], folder: Path) -> tuple[dict[str, str], list[str]]:
    return _identified(seen, folder, steps=True)


def _identification(seen: list[Inspected], folder: Path) -> tuple[dict[str, str], list[str]]:
    return _identified(seen, folder, steps=False)


def _actuator(seen: list[Inspected], folder: Path) -> tuple[dict[str, str], list[str]]:
    del folder
    if angles(seen):
        raise QuantityError(
            "these recordings are of an angle, and this writes an actuator that slides; a parameter set of "
            "one that turns has rotary = true, and units such as urad/V, N m and kg m^2"
        )
    gain, source = _gain(seen)
    value = float(f"{1e6 * gain:.4g}") if gain else 0.1
    said = f"source = {json.dumps(source)}" if gain else 'assumed = true\nreason = "a typical stack"'
    low, high, of = _voltages(seen)
    voltages = f'source = "{of}"' if of else 'assumed = true\nreason = "what such stacks take"'
    return {
        "gain": f'value = {value}\nunit = "um/V"\n{said}',
        "low": f"{low:g}",
        "high": f"{high:g}",
        "voltages": voltages,
    }, [source] if source and gain is None else []


def _experiment(seen: list[Inspected], folder: Path) -> tuple[dict[str, str], list[str]]:
    del folder
    low, high, _ = _voltages(seen)
    missing: list[str] = []
    runs = []
    for number, one in enumerate(seen, 1):
        if one.drive is None:
            missing.append(f"{one.found.path}: its drive is none of the usual waveforms; it is left out")
            continue
        time = one.found.recording["time"].values  # type: ignore[index]
        before = max((one.found.drive_begins or 0.0) - float(time[0]), 0.0)
        length = min(float(time[-1] - time[0]), MOST_RUN)
        interval = max(round(one.found.interval / _TICK), 1) * _TICK
        runs.append(
            _run(
                f"run_{number}", flow(one.drive), length, interval, before, f" # as in {one.found.path.name}"
            )
        )
    if not runs:
        low, high = min(low, 0.0), max(high, 80.0)
        step = "{shape: Step, fields: {amplitude: $voltage}}"
        walk = "{shape: Sawtooth, fields: {amplitude: $voltage, frequency: 20 Hz, periods: 8}}"
        runs = [
            _run(
                "step",
                step,
                0.3,
                _TICK,
                0.1,
                " # the end-effector fixed to the stage",
                "60 V, 80 V",
                clamped=True,
            ),
            _run("walk", walk, 0.7, 5 * _TICK, 0.1, "", "65 V, 75 V"),
        ]
    return {
        "runs": "\n".join(runs), "low": f"{low:g}", "high": f"{high:g}", "model": "kang2007",
        "range": f"min_voltage: {low:g}, max_voltage: {high:g}",
    }, missing  # fmt: skip


def _run(
    name: str, shape: str, length: float, interval: float, before: float, note: str,
    voltages: str = "", clamped: bool = False,
) -> str:  # fmt: skip
    trigger = "{signal: drive_voltage, level: 2 V}"
    lines = [f"name: {name}{note}"]
    lines += ["change: {clamped: true}"] if clamped else []
    lines += [f"matrix: {{voltage: [{voltages}]}}"] if voltages else []
    lines.append(f"waveform: [{shape}]")
    told = f"length: {length:.4g} s, interval: {1e6 * interval:g} us, pre_trigger: {before:.4g} s"
    lines.append(f"capture: {{{told}, trigger: {trigger}}}")
    return listed(lines)


_FILLED = {
    "campaign": _campaign,
    WALK: _identification,
    LOOPS: loops,
    PIEZO: piezo,
    "actuator": _actuator,
    "experiment": _experiment,
}
