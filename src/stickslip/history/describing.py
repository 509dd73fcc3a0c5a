"""Read recordings, fits, experiments and parameter sets, and return their columns for the index; change the
notes and tags of recordings and fits."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..gate.paths import inside
from ..gate.text import MOST_BYTES, MOST_RESULT_BYTES, decoded, load_json, read_file, read_json
from ..parameters.load import load_set
from ..quantities.input_file import load_yaml
from ..recording import RecordingError, open_recording
from ..recording.replacing import replaced_whole
from ..recording.storage import save_recording
from .storable import links_of, storable

if TYPE_CHECKING:
    import xarray as xr

RECORDINGS = (".nc", ".csv", ".mat", ".npz", ".npy", ".tsv", ".txt", ".mf4")

# Largest number of values of a list among the settings in the index; `_brief` replaces a longer list.
MOST_LISTED = 50

# Names of files beside the results.json of a fit or verification that `described_fit` reads: the user's notes
# and tags (NOTE), kind of the run and links to other runs (LINKS), and the state of the fit on the panel's
# pages (SHOWN).
NOTE, LINKS, SHOWN = "notes.json", "links.json", "shown.json"
BESIDE = (NOTE, LINKS, SHOWN)


def described(recording: xr.Dataset) -> dict[str, Any]:
    """Return the columns of a recording for the index, except its name, size and time of change.

    Keys are begun, title, notes, tags, operator, rig, parameter_set, outcome (texts, "" if unknown), seconds
    (duration), samples, channels, settings, links and, for a prediction, kind. `settings` is a dictionary
    with drive, capture, limits, variables of the experiment, the actuator as the file names it, and the
    properties of the contact (`contact`) that a virtual rig used. For a recording that no rig made,
    `settings` also contains its `source`, such as the name of the user's file, if known.
    """
    attrs = {str(name): value for name, value in recording.attrs.items()}
    time = recording["time"].values
    settings = {
        name: _brief(_read(attrs[name]))
        for name in ("variables", "capture", "limits", "contact", "drive")
        if attrs.get(name)
    }
    if attrs.get("actuator"):
        settings["actuator"] = str(attrs["actuator"])
    source, of_a_rig = str(attrs.get("source", "")), bool(attrs.get("capture"))
    if source and not of_a_rig:
        settings["source"] = source
    named = re.search(r"\bname='([\w.-]+)'", str(attrs.get("actuator", "")))
    return {
        "begun": str(attrs.get("epoch", "")),
        "title": str(attrs.get("title", "")),
        "notes": str(attrs.get("notes", "")),
        "tags": str(attrs.get("tags", "")),
        "operator": str(attrs.get("operator", "")),
        "rig": source if of_a_rig else "",
        "parameter_set": named[1] if named else "",
        "outcome": str(attrs.get("outcome", "")),
        "seconds": float(time[-1] - time[0]),
        "samples": int(time.size),
        "channels": ", ".join(str(name) for name in recording.data_vars),
        "settings": settings,
        **({"kind": "prediction"} if attrs.get("links") else {}),
        "links": load_json(str(attrs.get("links") or "{}"), "its links"),
    }


def described_fit(path: Path) -> dict[str, Any]:
    """Return the columns of a fit or verification for the index: kind, begun, title, notes, tags,
    parameter_set, outcome, settings (the numbers of the results) and links.

    They come from results.json, links.json, notes.json and, if the panel made the fit, from the panel's
    request in shown.json. `links` are the names of the recordings that were fitted ("fitted"), that verified
    the fit ("verified"), and that contain steps of the stage ("steps"); kinds in links.json are added, or
    replace these.

    Args:
        path: path of the results.json.

    Raises:
        GateError: a file of the folder cannot be read, or leads out of it.
        RecordingError: a file of the folder is not valid.
    """
    results, state, linked, said = (_mapping(path.parent, name) for name in (path.name, SHOWN, LINKS, NOTE))
    request, failures = state.get("request", {}), results.get("failures", [])
    if not isinstance(request, dict):
        raise RecordingError(f"{SHOWN}: its request is no mapping")
    links = {
        "fitted": request.get("recordings", []),
        "verified": request.get("others", []),
        "steps": request.get("steps", []),
    }
    return {
        "kind": linked.get("kind", "fit"),
        "begun": results.get("made") or results.get("created", ""),
        "title": results.get("title", ""),
        "notes": said.get("notes") or " ".join(str(results.get("summary", "")).split())[:500],
        "tags": said.get("tags", ""),
        "parameter_set": request.get("set", ""),
        "outcome": _outcome(str(state.get("phase", "done")), failures),
        "settings": results.get("numbers", {}),
        "links": links | links_of(linked.get("links", {})),
    }


def described_run(path: Path) -> dict[str, Any]:
    """Return the columns of an experiment that made no recording, such as one that was stopped at once.

    Args:
        path: log of the experiment, or the experiment's YAML file if there is no log.

    Returns:
        The columns title and outcome and, from a log, begun (time of the start).

    Raises:
        GateError, InputFileError: the file cannot be read.
    """
    nothing = "nothing was recorded"
    if path.suffix == ".yaml":
        content = load_yaml(path)
        return {
            "title": str(content.get("title", "")),
            "outcome": f"{nothing}: it was ended before it started, or starts now",
        }
    lines = decoded(read_file(path, MOST_RESULT_BYTES), path.name).splitlines()
    begun, _, title = lines[0].partition(" ") if lines else ("", "", "")
    last = lines[-1].partition(" ")[2] if lines else ""
    ended = last if last.startswith("stopped: ") else "it was ended before its first samples, or starts now"
    return {"begun": begun, "title": title, "outcome": f"{nothing}: {ended}"}


def _mapping(folder: Path, name: str, most: int = MOST_RESULT_BYTES) -> dict[str, Any]:
    """Return the mapping in the JSON file `name` of a folder; empty if the file does not exist.

    Raises:
        GateError: the file cannot be read, is larger than `most` bytes, or leads out of the folder.
        RecordingError: the content is no mapping.
    """
    path = inside(folder, name)
    found = read_json(path, most) if path.is_file() else {}
    if not isinstance(found, dict):
        raise RecordingError(f"{name} holds no mapping")
    return found


def _outcome(phase: str, failures: Any) -> str:
    """Return the outcome of a fit or verification: its phase or, after its end, "complete" or "not as
    required:" with the failures.

    "not as required" means that the model does not explain the data, or that a requirement is not met. The
    commands of the package then print the same words and end with an error.

    Args:
        phase: phase of the work in the panel, "done" after its end.
        failures: list of texts, each a requirement that is not met.
    """
    if phase not in ("done", "complete"):
        return phase
    said = "; ".join(map(str, failures)) if isinstance(failures, list) else ""
    return f"not as required: {said}" if said else "complete"


def _brief(value: Any) -> Any:
    """Return a JSON value in which each list of more than `MOST_LISTED` values, also a nested one, is
    replaced by a text with its length and checksum."""
    if isinstance(value, dict):
        return {key: _brief(one) for key, one in value.items()}
    if isinstance(value, list) and len(value) > MOST_LISTED:
        return f"{len(value)} values, {zlib.crc32(json.dumps(value).encode()):08x}"
    return [_brief(one) for one in value] if isinstance(value, list) else value


def _read(text: object) -> Any:
    try:
        return load_json(str(text), "")
    except ValueError:
        return str(text)


def described_set(path: Path) -> dict[str, Any]:
    """Return the columns of a parameter set for the index: title, parameter_set (the name of the file),
    outcome, settings (texts of value and unit by name) and links ("fit": the names of the fits that its
    values come from).

    Args:
        path: path of the set's TOML file.

    Raises:
        ParameterSetError: the file is not a valid parameter set.
    """
    found = load_set(path)
    entries = found.entries()
    fits = {one.source.removeprefix("fit ") for one in entries.values() if one.source.startswith("fit ")}
    settings = {name: f"{one.value} {one.unit}".strip() for name, one in entries.items()}
    return {
        "title": found.title,
        "parameter_set": path.stem,
        "outcome": "complete",
        "settings": settings,
        "links": {"fit": sorted(fits)},
    }


def annotate(
    path: Path,
    notes: str | None = None,
    tags: list[str] | None = None,
    read: Callable[[Path], xr.Dataset] = open_recording,
) -> None:
    """Change the notes or tags in a .nc file, or in the notes.json of a fit. The file is replaced as a whole
    or not at all.

    Args:
        path: a .nc file, or the folder of a fit (with results.json).
        notes: new notes; None keeps the present ones.
        tags: new tags, which replace all present ones; None keeps these.
        read: function from a path to the recording in the file.

    Raises:
        RecordingError, GateError: the path is neither a .nc file nor a fit, or cannot be read.
        OSError: the file cannot be written.
    """
    new: dict[str, str] = {}
    if notes is not None:
        new["notes"] = notes
    if tags is not None:
        new["tags"] = ", ".join(sorted({tag.strip() for tag in tags} - {""}))
    if (path / "results.json").is_file():
        said = storable({**_mapping(path, NOTE, MOST_BYTES), **new})
        with replaced_whole(path / NOTE) as temporary:
            temporary.write_text(json.dumps(said, ensure_ascii=False), encoding="utf-8")
        return
    if path.suffix != ".nc":
        raise RecordingError(f"{path}: notes and tags are kept in .nc files; save it as one first")
    recording = read(path)
    recording.attrs |= new
    save_recording(recording, path)
