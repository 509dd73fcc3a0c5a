"""Entries of the index, read from the files."""

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

MOST_LISTED = 50  # largest number of values of a list in an entry

NOTE, LINKS = "notes.json", "links.json"  # in a fit's folder: the user's notes, and the recordings of the fit
NOTES = (NOTE, LINKS)


def described(recording: xr.Dataset) -> dict[str, Any]:
    """Return the columns of a recording for the index, except its name and size.

    `settings` are drive, capture, limits, variables of the experiment, the actuator as in the file, and the
    contact's properties that a virtual rig used in the run. For a recording from a user's file, they contain
    the name of that file.
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
    """Return the columns of a fit from its results.json, and from the request of the panel, if there is one.

    `links` are the recordings that it was made from, those that verified it, and steps of the stage.

    Raises:
        GateError: a file of the folder cannot be read, or leads out of it.
        RecordingError: a file of the folder is not valid.
    """
    results, state, linked, said = (
        _mapping(path.parent, name) for name in (path.name, "shown.json", LINKS, NOTE)
    )
    request, failures = state.get("request", {}), results.get("failures", [])
    if not isinstance(request, dict):
        raise RecordingError("shown.json: its request is no mapping")
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
    """Return the columns of an experiment without a recording, from its log, or from its file if it has none.

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
    """Return the content of a JSON file of a folder, of up to `most` bytes; empty if it does not exist."""
    path = inside(folder, name)
    found = read_json(path, most) if path.is_file() else {}
    if not isinstance(found, dict):
        raise RecordingError(f"{name} holds no mapping")
    return found


def _outcome(phase: str, failures: Any) -> str:
    """Return the outcome of a fit or verification.

    A finished one may still report that its model does not explain the data, or that a requirement is not
    met. The word is the same as in the commands, which then end with an error.
    """
    if phase not in ("done", "complete"):
        return phase
    said = "; ".join(map(str, failures)) if isinstance(failures, list) else ""
    return f"not as required: {said}" if said else "complete"


def _brief(value: Any) -> Any:
    """Return a value; a long list is replaced by its length and a checksum."""
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
    """Return the columns of a parameter set that was saved from a fit; `links` is that fit."""
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
    """Change the notes or tags of a recording, or of the folder of a fit, completely or not at all.

    Raises:
        RecordingError, GateError: it is neither a .nc file nor a fit, or cannot be read.
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
