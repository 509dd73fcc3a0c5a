"""Analysis: a fitted actuator against recordings of its walk, and what is required of it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import xarray as xr
from pydantic import Field, ValidationError

from ...identify.results import model_numbers
from ...identify.verification import Requirement, Verification, verify
from ...identify.walk.prediction import Predictor
from ...quantities.input_file import Seconds, explain, load_yaml
from ...quantities.progress import Progress
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError, near_one, with_prefix
from ...recording.chain import Chain
from ...recording.readers import inspect_file
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.identification import fit_with_residuals
from ...report.figures.style import svg
from ...report.origin import origin_of
from ...waveform.signal import Waveform
from .alignment import POSITION, aligned, aligned_by_itself, on_level, said_drives
from .file import Analysis, AnalysisError, read_parts
from .model import ModelOrFit
from .results import model_and_chain
from .walk import WalkRecording

MOST_PICTURES = 8
DRIVE = "drive_voltage"
_READ = ("time", POSITION, DRIVE)
_EXAMPLES = {"--column": 'end_effector_position="Disp (um)"', "--unit": "drive_voltage=kV"}


class VerificationAnalysis(Analysis, ModelOrFit):
    """See the module. `require`: sentences such as "r_squared > 0.99"."""

    kind: Literal["verification"] = "verification"
    delay: Seconds = 0.0
    recordings: list[WalkRecording] = Field(min_length=1)
    require: list[str] = Field(default_factory=list)

    def run(self, folder: Path, progress: Progress) -> Document:
        """Predict everything."""
        requirements = [Requirement.parse(text) for text in self.require]
        predictor, chain = self._predictor(folder)
        progress("reading", 0.0)
        parts = read_parts(self.recordings, folder)
        for name, part in parts.items():
            if POSITION not in part:
                raise AnalysisError(
                    f"{name} has no {POSITION} [m], which 'columns' names; "
                    f"it has {', '.join(map(str, part.data_vars))}"
                )
        drives = [r.waveform(folder) for r in self.recordings]
        progress("predicting", 0.2)
        if chain.zeroed:
            found = _verified(predictor, chain, parts, drives)
        else:
            found = verify(predictor, list(parts.values()), drive=drives)
        failures = [*found.unmet(requirements), *found.statements]
        least = min(found.table["r_squared"].values)
        said = (
            f"{len(parts)} recording{'s' * (len(parts) > 1)} predicted, nothing fitted: r² {near_one(least)} "
            f"or more, rms error {with_prefix(found.rmse, found.unit, 3)}."
        )
        if requirements:
            count = len(requirements)
            all_of_them = f"ll of the {count} requirements" if count > 1 else "ll that is required is"
            said += f" {'NOT a' if found.unmet(requirements) else 'A'}{all_of_them} met."
        sentences = (*found.statements, *found.remarks, *found.taken)
        said += "".join(f" {text[0].upper()}{text[1:]}." for text in sentences)
        progress("drawing", 0.6)
        origin = origin_of(predictor.model, parts.values())
        return Document(
            title=self.title,
            summary=said,
            sections=[
                Section(
                    "Recordings",
                    paragraphs=(self.notes,) if self.notes else (),
                    points=[*(f"required: {text}" for text in self.require), *found.taken],
                    tables=(verification_table(found),),
                    figures=prediction_pictures(found),
                )
            ],
            highlights=[
                ("least r²", Number(float(least), "")),
                ("rms error", Number(found.rmse, found.unit)),
            ],
            numbers={
                "verification": verification_numbers(found),
                "model": model_numbers(predictor.model),
                "required": list(self.require),
                "drives": list(found.taken),
            },
            assumptions=origin.assumptions,
            citations=origin.citations,
            failures=failures,
        )

    def _predictor(self, folder: Path) -> tuple[Predictor, Chain]:
        model, chain = self.load_model_and_chain(folder)
        chain = chain._replace(delay=self.delay or chain.delay)
        return Predictor(model, chain), chain


def _verified(
    predictor: Predictor, chain: Chain, parts: Mapping[str, xr.Dataset], drives: Sequence[Waveform | None]
) -> Verification:
    """As the campaign that found the chain predicts: the same cut, bias, scale and drive at the piezo."""
    found = []
    for (name, part), drive in zip(parts.items(), drives, strict=True):
        if drive is None:
            one = aligned_by_itself(part, name, chain.slew_rate, chain.scale)
        else:
            known = None if DRIVE in part else float(part["time"][0])
            one = aligned(part, drive, name, chain.slew_rate, chain.scale, known)
        found.append(on_level(one, predictor.model))
    verified = verify(predictor, [one.recording for one in found], drive=[one.drive for one in found])
    return replace(verified, taken=tuple(said_drives(found)))


def verification_analysis(
    path: str | os.PathLike[str],
    recordings: Sequence[str | os.PathLike[str]],
    require: Sequence[str],
    columns: Sequence[str] = (),
    units: Sequence[str] = (),
) -> tuple[VerificationAnalysis, Path]:
    """What the command line asks for, and the folder that its files are relative to.

    Args:
        path: a verification file, a results.json, or a fit of `save_fit`.
        recordings: with one of the last two, the files to predict; their drive is the channel drive_voltage.
        require: further requirements.
        columns, units: of these files, "NAME=COLUMN" and "NAME=UNIT"; what they leave out is found as
            `inspect_file` finds it, and said in the report.

    Raises:
        AnalysisError: the file, or a requirement, is not as it must be, or recordings are named twice or not
            at all.
        RecordingError: a recording cannot be read.
    """
    path = Path(path)
    _check_limits("--require", require)
    if path.suffix == ".json":
        if not recordings:
            raise AnalysisError(
                f"{path}: name the recordings to predict: stickslip verify {path.name} my.csv"
            )
        # Before columns are asked for, which would not help what holds no model of a walk.
        model_and_chain(path)
        named, said = _pairs("--column", columns), _pairs("--unit", units)
        entries = [_entry(Path(file), named, said) for file in recordings]
        content: dict[str, Any] = {
            "kind": "verification",
            "title": "Verification",
            "notes": " ".join(note for _, note in entries if note),
            "fit": path.name,
            "recordings": [entry for entry, _ in entries],
        }
    else:
        content = load_yaml(path)
        if recordings or columns or units:
            wrong = f"recording {recordings[0]}" if recordings else "--column" if columns else "--unit"
            raise AnalysisError(
                f"{wrong}: goes with a results.json; {path} is a verification file and names its recordings"
            )
    try:
        analysis = VerificationAnalysis.model_validate(content)
    except ValidationError as error:
        raise explain(path, error, content=content) from error
    _check_limits(f"{path}: require", analysis.require)
    return analysis.model_copy(update={"require": [*analysis.require, *require]}), path.parent


def _check_limits(where: str, require: Sequence[str]) -> None:
    """Before anything is read: raises AnalysisError."""
    for text in require:
        try:
            Requirement.parse(text)
        except QuantityError as error:
            raise AnalysisError(f"{where}: {error}") from error


def _pairs(option: str, given: Sequence[str]) -> dict[str, str]:
    found = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise AnalysisError(f"{option} {text}: write NAME=..., such as {option} {_EXAMPLES[option]}")
        found[name.strip()] = value.strip()
    return found


def _entry(file: Path, named: Mapping[str, str], units: Mapping[str, str]) -> tuple[dict[str, Any], str]:
    """What a verification file would say of a recording, and what had to be guessed, in words.

    Raises:
        AnalysisError: a column that is needed is not named and not found; says the option that names it.
        RecordingError: the file cannot be read.
    """
    entry: dict[str, Any] = {"file": os.path.abspath(file)}
    found = inspect_file(file)
    if found.reader == "recording":
        return entry, ""
    for option, given in (("--column", named), ("--unit", units)):
        for name in given:
            if name not in _READ:
                hint = did_you_mean(name, _READ)
                raise AnalysisError(
                    f"{option} {name}: there is no {name!r} here{hint}; there are {', '.join(_READ)}"
                )
    columns = {name: one for name, one in found.named.items() if name in _READ and one not in named.values()}
    columns |= named
    there = ", ".join(repr(one["name"]) for one in found.columns if one["numeric"])
    for name in (POSITION, DRIVE):
        if name not in columns:
            raise AnalysisError(f"{file}: which column is {name}? Say --column {name}=..., of {there}")
    said = {name: units.get(name, found.units.get(name, "")) for name in _READ}
    entry |= {"columns": columns, "units": {name: unit for name, unit in said.items() if unit}}
    guessed = [f"{name} from {columns[name]!r}" for name in columns if name not in named]
    guessed += [f"{name} in {unit}" for name, unit in said.items() if unit and name not in units]
    return entry, f"Read from {file.name} without being told: {', '.join(guessed)}." if guessed else ""


def verification_table(found: Verification, roles: Sequence[str] = ()) -> Table:
    """r², rms error and the error of the net step, one row for each recording."""
    table = found.table
    rows = []
    for i, name in enumerate(table["recording"].values):
        r_squared, rmse, step, error = (
            float(table[key][i]) for key in ("r_squared", "rmse", "net_step", "net_step_error")
        )
        role = (roles[i],) if roles else ()
        known = math.isfinite(step)
        rows.append(
            (
                str(name),
                *role,
                r_squared,
                rmse,
                step if known else None,
                100.0 * error if known else None,
            )
        )
    columns = [
        Column("r²", "", 5),
        Column("rms error", found.unit, 3),
        Column("net step, measured", found.unit),
    ]
    role = [Column("role")] if roles else []
    return Table(
        "Measured and predicted.",
        (Column("recording"), *role, *columns, Column("error of the net step", "%", 2)),
        rows,
        notes="r² = (SST − SSE)/SST; the net step is the displacement per period of the drive.",
    )


def verification_numbers(found: Verification) -> dict[str, Any]:
    """The same for results.json, by recording."""
    table = found.table
    return {
        str(name): {
            key: Number(float(table[key][i]), str(table[key].attrs["units"])) for key in table.data_vars
        }
        for i, name in enumerate(table["recording"].values)
    }


def prediction_pictures(found: Verification) -> list[Picture]:
    """Measured, predicted and the residual of the first recordings."""
    return [
        Picture(
            f"prediction_{i + 1}",
            f"{good.name}: end-effector position, measured and predicted.",
            svg(
                fit_with_residuals(
                    p["time"].values,
                    p["measured"].values,
                    p["predicted"].values,
                    name="end-effector position",
                    unit=found.unit,
                )
            ),
            "Position over time, data under the model, and the residuals below",
        )
        for i, (good, p) in enumerate(zip(found.recordings[:MOST_PICTURES], found.predictions, strict=False))
    ]
