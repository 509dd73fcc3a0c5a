"""Routes of the next steps after a fit: save a parameter set, predict, send the drive to the bench, verify.

All but sending leave a file with links to its sources, by name; a recording of a sent drive is linked when
its run ends. The pages Identify and History show the links.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

from fastapi import APIRouter, Request
from pydantic import Field

from ..gate.elsewhere import applied
from ..history import Index, note_act
from ..history.index import READING
from ..history.walking import SETS
from ..jobs.analysis.fit_parameters import fit_parameters, results_summary
from ..parameters.writing import write_parameters
from ..physics.actuator import Actuator
from ..quantities.input_file import Strict
from ..quantities.registry import used_files
from ..quantities.units import QuantityError, unit_for, with_prefix
from ..recording import make_recording, save_recording
from ..recording.readers.process import Reader
from ..simulation import simulate, steady_step
from ..waveform.signal import shape
from .control import Control
from .document import BenchDocument
from .folder import Folder, FolderError
from .journal import Journal
from .sets import Sets
from .stream import Hub

PREDICTIONS = "predictions"  # subfolder of the panel's folder that contains the predictions
PREDICTED = "predicted"  # name of the run of the experiment that has the predicted drive
# First words of the notes of this run; the name of the prediction's file follows.
SAID = "As predicted in "
_SAMPLES = 4000  # number of samples of a prediction, drive and rest together
_LONGEST = 60.0  # longest drive of a prediction, s
# time that is simulated after the drive, s; a recording on the bench is twice this longer than its drive
_REST = 0.2
_PATIENCE = 300.0  # longest time of a verification, s; then its process is ended


class Save(Strict):
    """Request to save a fit as a parameter set.

    `fit` is the fit's subfolder of the panel's folder. `name` is the name of the set, which must be new.
    """

    fit: str
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_. -]{0,59}$")


class PathDrive(Strict):
    """A periodic drive for a number of periods, as the file of a prediction keeps it in its attributes.

    `shape` is the name of a waveform. `amplitude` [V] and `frequency` [Hz] are numbers or texts with units.
    """

    shape: str = Field(pattern="^(Sawtooth|ReverseSawtooth|Triangle|Cycloid|Sine)$")
    amplitude: float | str
    frequency: float | str
    periods: int = Field(ge=1, le=1000)

    def forever(self) -> Any:
        """Return the drive without an end, for its steady step; raises QuantityError for a wrong value."""
        return shape(self.shape)(amplitude=self.amplitude, frequency=self.frequency)


class Prediction(PathDrive):
    """Request to simulate an actuator under a drive; `parameters` is the name of its parameter set, see
    `Sets`."""

    parameters: str


class Sent(Strict):
    """Request to put the drive of a prediction on the bench; `prediction` is the name of its file."""

    prediction: str


class Check(Strict):
    """Request to verify a fit; `fit` is its subfolder, and `recordings` are the names of recordings to
    predict."""

    fit: str
    recordings: list[str] = Field(min_length=1, max_length=20)


def path_routes(
    folder: Folder,
    hub: Hub,
    control: Control,
    journal: Journal,
    document: BenchDocument,
    read: Reader,
    sets: Sets,
) -> APIRouter:
    """Return the router with the routes of the next steps after a fit, below "/path".

    "/send" needs control of the rig.

    Args:
        folder: the panel's folder.
        hub: sends changes to the pages.
        control, journal, document: control of the rig, log, and experiment on the bench.
        read: reads recordings in a process of its own.
        sets: parameter sets on offer.
    """
    routes = APIRouter(prefix="/path")

    @routes.get("")
    def state(fit: str) -> dict[str, Any]:
        folder.path(fit)
        return _linked(folder, read, fit)

    @routes.post("/save")
    def save(asked: Save) -> dict[str, str]:
        made = partial(fit_parameters, title=asked.name, source=f"fit {asked.fit}", used=used_files())
        text = applied(made, _results(folder, asked.fit))
        path = folder.path(f"{SETS}/{asked.name}.toml")
        try:
            write_parameters(path, text)
        except FileExistsError:
            raise QuantityError(
                f"there is a parameter set {asked.name!r} already: give another name"
            ) from None
        return _made(folder.name(path), f"{asked.fit}: saved as the parameter set {asked.name}")

    @routes.post("/predict")
    def predict(asked: Prediction) -> dict[str, Any]:
        made, numbers = _predicted(sets.actuator(asked.parameters), asked)
        made.attrs["links"] = json.dumps({"parameters": [asked.parameters]})
        name = f"{PREDICTIONS}/{datetime.now():%Y-%m-%d_%H%M%S_%f}.nc"
        folder.path(name).parent.mkdir(exist_ok=True)
        save_recording(made, folder.path(name))
        return {**_made(name, f"{name}: predicted with {asked.parameters}"), "numbers": numbers}

    @routes.post("/send")
    def send(asked: Sent, request: Request) -> dict[str, str]:
        control.need(request.headers.get("x-client", ""))
        recording = read(folder.path(asked.prediction))
        try:
            drive = PathDrive.model_validate_json(str(recording.attrs["variables"]))
        except (KeyError, ValueError):
            raise QuantityError(f"{asked.prediction} is no prediction: it names no drive") from None
        runs = [one for one in document.checked.content["runs"] if one["name"] != PREDICTED]
        document.change(["runs"], [*runs, _run(asked.prediction, drive, runs)])
        hub.send(json.dumps({"kind": "experiment", **document.described()}))
        note_act(folder.root, "drive sent to the bench", asked.prediction)
        journal(f"{asked.prediction}: its drive is on the bench, as the run {PREDICTED}")
        return {"run": PREDICTED}

    @routes.post("/verify")
    def verify(asked: Check) -> dict[str, Any]:
        _results(folder, asked.fit)
        out = f"verifications/{datetime.now():%Y-%m-%d_%H%M%S_%f}"
        _verified(folder, asked, folder.path(out))
        links = {"kind": "verification", "links": {"fit": [asked.fit], "of": asked.recordings}}
        folder.path(f"{out}/links.json").write_text(json.dumps(links), encoding="utf-8")
        summary = applied(results_summary, folder.path(f"{out}/results.json"))
        return {**_made(out, f"{asked.fit}: verified"), "summary": summary}

    def _made(name: str, said: str) -> dict[str, str]:
        journal(said)
        hub.tell("recordings")
        return {"name": name}

    return routes


def _linked(folder: Folder, read: Reader, name: str) -> dict[str, Any]:
    """Return the names of the results that were made from the fit with the name `name`.

    Keys: "sets", "predictions" (with these sets), "recordings" (with the drive of such a prediction),
    "verifications", and "others": at most 100 readable recordings, not among the fit's walks and steps, on
    which it can be verified.
    """
    with Index(folder.root, read) as index:
        index.patience = READING
        rows = index.rows()
    links = {row["name"]: json.loads(row["links"] or "{}") for row in rows}

    def of(kind: str, key: str, sources: list[str]) -> list[str]:
        named = {row["name"] for row in rows if row["kind"] == kind}
        return [one for one in links if one in named and set(links[one].get(key, [])) & {*sources}]

    sets = of("parameters", "fit", [name])
    predictions = of("prediction", "parameters", sets)
    seen = {*links.get(name, {}).get("fitted", []), *links.get(name, {}).get("steps", [])}
    others = [r["name"] for r in rows if r["kind"] == "recording" and not r["problem"]]
    return {
        "sets": sets,
        "predictions": predictions,
        "recordings": of("recording", "prediction", predictions),
        "others": [one for one in others if one not in seen][:100],
        "verifications": of("verification", "fit", [name]),
    }


def predicted_of(run: dict[str, Any]) -> str | None:
    """Return the name of the prediction whose drive a run of the experiment uses, None for another drive.

    The name is read from the notes in `run`, the entry of an experiment file.
    """
    found = re.match(re.escape(SAID) + r"(predictions/[\w.-]+\.nc)", str(run.get("notes", "")))
    return found[1] if found else None


def _results(folder: Folder, fit: str) -> Path:
    path = folder.path(f"{fit}/results.json")
    if not path.is_file():
        raise FolderError(f"{fit[:60]!r} is no fit")
    return path


def _predicted(actuator: Actuator, asked: Prediction) -> tuple[Any, dict[str, Any]]:
    forever = asked.forever()
    amplitude, frequency = forever.amplitude, forever.frequency
    duration = asked.periods / frequency
    if duration > _LONGEST:
        raise QuantityError(
            f"{asked.periods} periods at {with_prefix(frequency, 'Hz')} take {duration:.3g} s; a prediction "
            f"has at most {_LONGEST:g} s"
        )
    drive = forever._replace(periods=float(asked.periods))
    moved = simulate(actuator, drive, duration=duration + _REST, sample_rate=_SAMPLES / (duration + _REST))
    channels = {
        name: (moved[name].values, str(moved[name].attrs["units"]))
        for name in ("drive_voltage", "stage_position", "end_effector_position")
    }
    title = f"{asked.periods} periods of {asked.shape}, {amplitude:g} V, {frequency:g} Hz"
    made = make_recording(
        moved["time"].values,
        channels,
        title=title,
        notes=f"Simulated with {asked.parameters}.",
        source="simulation",
        epoch=datetime.now().astimezone().isoformat(timespec="seconds"),
    )
    fields = {"amplitude": amplitude, "frequency": frequency, "periods": asked.periods}
    made.attrs["variables"] = json.dumps({"shape": asked.shape, **fields})
    made.attrs["outcome"] = "complete"
    position = moved["end_effector_position"].values
    step = steady_step(actuator, forever)
    net, unit = float(position[-1] - position[0]), unit_for(actuator, "m")
    return made, {"net_displacement": net, "steady_step": step, "unit": unit}


def _run(prediction: str, drive: PathDrive, runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a run with this drive, as an entry of "runs" in an experiment file.

    The run is sampled as the first of the other `runs`, or at the rig's full rate without one. The rise of
    the channel drive_voltage triggers its recording. Its notes name the prediction, see `predicted_of`.
    """
    forever = drive.forever()
    amplitude, frequency = forever.amplitude, forever.frequency
    capture = runs[0]["capture"] if runs else {}
    kept = {name: capture[name] for name in ("interval", "down_sampling") if name in capture}
    level = f"{min(1.0, 0.05 * abs(amplitude))} V"
    fields = {"amplitude": f"{amplitude} V", "frequency": f"{frequency} Hz", "periods": drive.periods}
    return {
        "name": PREDICTED,
        "notes": f"{SAID}{prediction}.",
        "waveform": [{"shape": drive.shape, "fields": fields}],
        "capture": {
            "length": f"{drive.periods / frequency + 2 * _REST:.6g} s",
            **(kept or {"down_sampling": 1}),
            "pre_trigger": "0.1 s",
            "trigger": {"signal": "drive_voltage", "level": level},
        },
    }


def _verified(folder: Folder, asked: Check, out: Path) -> None:
    """Run `stickslip verify` in a process of its own, which writes its report into the folder `out`.

    Raises FolderError if a recording is missing, and QuantityError if the command failed (with its last
    message) or took more than `_PATIENCE` seconds.
    """
    paths = [folder.path(name) for name in asked.recordings]
    missing = [name for name, path in zip(asked.recordings, paths, strict=True) if not path.is_file()]
    if missing:
        raise FolderError(f"{missing[0][:60]!r} is no recording")
    own = [word for file in used_files() for word in ("--use", file)]
    command = [
        sys.executable,
        "-m",
        "stickslip",
        *own,
        "verify",
        str(folder.path(f"{asked.fit}/results.json")),
    ]
    try:
        done = subprocess.run(
            [*command, *map(str, paths), "--out", str(out)],
            capture_output=True,
            text=True,
            timeout=_PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise QuantityError(f"the verification took more than {_PATIENCE:g} s, and was ended") from None
    if done.returncode or not (out / "results.json").is_file():
        said = (done.stderr.strip() or done.stdout.strip() or "it ended without a word").splitlines()[-1]
        raise QuantityError(said.removeprefix("stickslip: "))
