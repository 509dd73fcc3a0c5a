"""Analysis that verifies a fitted actuator: it predicts recordings of walks and checks requirements."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, ValidationError

from ...identify.results import model_numbers
from ...identify.verification import Requirement, Verification, verify
from ...identify.walk.prediction import Predictor
from ...quantities.input_file import Seconds, explain, load_yaml
from ...quantities.places import assignment
from ...quantities.progress import Progress
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError
from ...recording.chain import Chain
from ...recording.readers import inspect_file
from ...report import Document
from ...report.origin import origin_of
from ...report.viewing import view
from ...waveform.signal import Waveform
from .alignment import POSITION, aligned, aligned_by_itself, on_level, said_drives
from .file import Analysis, AnalysisError, read_parts
from .model import ModelOrFit
from .results import model_and_chain
from .walk import WalkRecording

if TYPE_CHECKING:
    import xarray as xr

DRIVE = "drive_voltage"
_READ = ("time", POSITION, DRIVE)
_EXAMPLES = {"--column": 'end_effector_position="Disp (um)"', "--unit": "drive_voltage=kV"}


class VerificationAnalysis(Analysis, ModelOrFit):
    """Request to verify a fitted actuator on recordings of walks.

    `delay` is the delay of the position channel [s]; 0 means the delay of the fit. `require` lists
    requirements on the predictions, such as "r_squared > 0.99".
    """

    kind: Literal["verification"] = "verification"
    delay: Seconds = 0.0
    recordings: list[WalkRecording] = Field(min_length=1)
    require: list[str] = Field(default_factory=list)

    def run(self, folder: Path, progress: Progress) -> Document:
        """Predict all recordings and check the requirements; return the report.

        Raises the errors of `load_model` and `read_parts`, AnalysisError if a recording has no
        end_effector_position, and QuantityError for a wrong requirement.
        """
        for text in self.require:
            Requirement.parse(text)
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
        progress("drawing", 0.6)
        return self._document(found, predictor, parts)

    def _document(
        self, found: Verification, predictor: Predictor, parts: Mapping[str, xr.Dataset]
    ) -> Document:
        """Return the report of the verification, with its requirements.

        Args:
            found: result of the verification.
            predictor: model and signal chain that made the predictions.
            parts: recordings by name.
        """
        unmet = found.unmet([Requirement.parse(text) for text in self.require])
        made, count = view(found, self.title), len(self.require)
        origin = origin_of(predictor.model, parts.values())
        said = made.summary
        if count:
            all_of_them = f"ll of the {count} requirements" if count > 1 else "ll that is required is"
            said += f" {'NOT a' if unmet else 'A'}{all_of_them} met."
        (section,) = made.sections
        points = [*(f"required: {text}" for text in self.require), *section.points, *_said_cut(found, parts)]
        notes = (self.notes,) if self.notes else ()
        return replace(
            made,
            summary=said,
            sections=[replace(section, paragraphs=notes, points=points)],
            numbers={
                **made.numbers,
                "model": model_numbers(predictor.model),
                "required": list(self.require),
            },
            assumptions=origin.assumptions,
            citations=origin.citations,
            failures=[*unmet, *made.failures],
        )

    def _predictor(self, folder: Path) -> tuple[Predictor, Chain]:
        model, chain = self.load_model_and_chain(folder)
        chain = chain._replace(delay=self.delay or chain.delay)
        return Predictor(model, chain), chain


def _verified(
    predictor: Predictor, chain: Chain, parts: Mapping[str, xr.Dataset], drives: Sequence[Waveform | None]
) -> Verification:
    """Predict recordings as in the campaign that found the chain; return the verification.

    The recordings are cut, freed of their bias, scaled and aligned with their drives as in the campaign.

    Args:
        predictor: model and signal chain.
        chain: signal chain of the position channel, with the scale and slew rate of the campaign.
        parts: recordings by name.
        drives: waveform of each recording, in the order of `parts`; None: the recording's attributes or its
            channel drive_voltage show the drive.
    """
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


def _said_cut(found: Verification, parts: Mapping[str, xr.Dataset]) -> list[str]:
    """Return a sentence on each recording of which only a part is judged; `parts` are whole recordings."""
    sizes = [(good, part.sizes["time"]) for good, part in zip(found.recordings, parts.values(), strict=True)]
    return [
        f"{good.name}: {good.n_data} of {size} samples are judged, those up to shortly after the drive"
        for good, size in sizes
        if good.n_data < size
    ]


def verification_analysis(
    path: str | os.PathLike[str],
    recordings: Sequence[str | os.PathLike[str]],
    require: Sequence[str],
    columns: Sequence[str] = (),
    units: Sequence[str] = (),
    changes: Sequence[str] = (),
) -> tuple[VerificationAnalysis, Path]:
    """Return the verification that a command line requests, and the folder of its relative paths.

    Args:
        path: a verification file, a results.json, or a fit of `save_fit`.
        recordings: files to predict, if `path` is no verification file; their drive is taken from their
            attributes or the channel drive_voltage.
        require: further requirements, such as "r_squared > 0.99".
        columns, units: columns and units of these files, "NAME=COLUMN" and "NAME=UNIT"; missing ones are
            guessed by `inspect_file`, and the report says so. Recordings of this package need none.
        changes: changes to a verification file, as for `load_yaml`.

    Raises:
        AnalysisError: the file or a requirement is invalid, or recordings are named twice or not at all.
        RecordingError: a recording cannot be read.
    """
    path = Path(path)
    _check_limits("--require", require)
    if path.suffix == ".json":
        if changes:
            raise AnalysisError(f"--set {changes[0]}: changes a verification file; {path.name} is none")
        if not recordings:
            raise AnalysisError(
                f"{path}: name the recordings to predict: stickslip verify {path.name} my.csv"
            )
        # The model is read before the recordings, so that a file without a model is reported before missing
        # columns.
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
        if path.suffix not in (".yaml", ".yml"):
            raise AnalysisError(
                f"{path}: the first argument of verify is the results.json of an identification, or a "
                "verification file (.yaml) alone; recordings follow results.json"
            )
        content = load_yaml(path, changes)
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
    """Raise AnalysisError if a requirement cannot be parsed, before any recording is read.

    `where` is the place of the requirements, for the message.
    """
    for text in require:
        try:
            Requirement.parse(text)
        except QuantityError as error:
            raise AnalysisError(f"{where}: {error}") from error


def _pairs(option: str, given: Sequence[str]) -> dict[str, str]:
    write = f"NAME=..., such as {option} {_EXAMPLES[option]}"
    try:
        return dict(assignment(option, text, write) for text in given)
    except QuantityError as error:
        raise AnalysisError(str(error)) from None


def _entry(file: Path, named: Mapping[str, str], units: Mapping[str, str]) -> tuple[dict[str, Any], str]:
    """Return the entry of a recording for a verification file, and a note on guesses ("" without any).

    The entry is a mapping of the fields of `WalkRecording`.

    Args:
        file: path of the recording.
        named: columns that the user has named, by name of the channel.
        units: units that the user has named, by name of the channel.

    Raises:
        AnalysisError: a required column is neither named nor found, or there is no channel of a given name;
            the message names the option.
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
