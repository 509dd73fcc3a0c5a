"""Entries of the index, read from the files."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import xarray as xr

from ..parameters.load import load_set
from ..recording import RecordingError, open_recording
from ..recording.replacing import replaced_whole
from ..recording.storage import save_recording

RECORDINGS = (".nc", ".csv", ".mat", ".npz", ".npy", ".tsv", ".txt", ".mf4")

MOST_LISTED = 50  # values of a list that an entry holds

NOTES = ("notes.json", "links.json")  # in a fit's folder: somebody's words, and what it was made of


def described(recording: xr.Dataset) -> dict[str, Any]:
    """The columns of a recording, but for its name and size.

    `settings` is what makes it: drive, capture, limits, variables of the experiment, the actuator as the file
    says it, and what a virtual rig says of its contact in that run; of what no rig recorded, where it is
    from, a file that was taken in by its name.
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
        "settings": json.dumps(settings, ensure_ascii=False),
        **({"kind": "prediction"} if attrs.get("links") else {}),
        "links": str(attrs.get("links", "")),
    }


def described_fit(path: Path) -> dict[str, Any]:
    """The columns of a fit: a folder with results.json, and, of the panel, what was asked for.

    `links` are the recordings that it was made from, those that verified it, and steps of the stage.
    """
    results = json.loads((path / "results.json").read_text(encoding="utf-8"))
    shown = path / "shown.json"
    state = json.loads(shown.read_text(encoding="utf-8")) if shown.is_file() else {}
    request = state.get("request", {})
    links = {
        "fitted": request.get("recordings", []),
        "verified": request.get("others", []),
        "steps": request.get("steps", []),
    }
    linked, said = (
        json.loads((path / one).read_text(encoding="utf-8")) if (path / one).is_file() else {}
        for one in ("links.json", "notes.json")
    )
    links |= linked.get("links", {})
    return {
        "kind": str(linked.get("kind", "fit")),
        "begun": str(results.get("made") or results.get("created", "")),
        "title": str(results.get("title", "")),
        "notes": str(said.get("notes") or " ".join(str(results.get("summary", "")).split())[:500]),
        "tags": str(said.get("tags", "")),
        "parameter_set": str(request.get("set", "")),
        "outcome": _outcome(str(state.get("phase", "done")), results.get("failures", [])),
        "settings": json.dumps(results.get("numbers", {}), ensure_ascii=False),
        "links": json.dumps({name: given for name, given in links.items() if given}, ensure_ascii=False),
    }


def _outcome(phase: str, failures: Any) -> str:
    """Of a fit or a verification: one that ended may still say that its model does not explain the data, or
    that a requirement is not met. The word is that of the commands, which end with an error then."""
    if phase not in ("done", "complete"):
        return phase
    said = "; ".join(map(str, failures)) if isinstance(failures, list) else ""
    return f"not as required: {said}" if said else "complete"


def _brief(value: Any) -> Any:
    """As it is, but of long lists their number and a checksum: a drive of samples stays in its file."""
    if isinstance(value, dict):
        return {key: _brief(one) for key, one in value.items()}
    if isinstance(value, list) and len(value) > MOST_LISTED:
        return f"{len(value)} values, {zlib.crc32(json.dumps(value).encode()):08x}"
    return [_brief(one) for one in value] if isinstance(value, list) else value


def _read(text: object) -> Any:
    try:
        return json.loads(str(text))
    except ValueError:
        return str(text)


def described_set(path: Path) -> dict[str, Any]:
    """The columns of a parameter set that a fit was saved as; `links` is that fit."""
    found = load_set(path)
    entries = found.entries()
    fits = {one.source.removeprefix("fit ") for one in entries.values() if one.source.startswith("fit ")}
    settings = {name: f"{one.value} {one.unit}".strip() for name, one in entries.items()}
    return {
        "title": found.title,
        "parameter_set": path.stem,
        "outcome": "complete",
        "settings": json.dumps(settings, ensure_ascii=False),
        "links": json.dumps({"fit": sorted(fits)}) if fits else "",
    }


def annotate(
    path: Path,
    notes: str | None = None,
    tags: list[str] | None = None,
    read: Callable[[Path], xr.Dataset] = open_recording,
) -> None:
    """Change the notes or the tags that a recording, or the folder of a fit, keeps; all of it or nothing.

    Raises:
        RecordingError: it is neither a .nc file nor a fit, or cannot be read.
    """
    new: dict[str, str] = {}
    if notes is not None:
        new["notes"] = notes
    if tags is not None:
        new["tags"] = ", ".join(sorted({tag.strip() for tag in tags} - {""}))
    if (path / "results.json").is_file():
        kept = path / NOTES[0]
        said = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
        with replaced_whole(kept) as temporary:
            temporary.write_text(json.dumps({**said, **new}, ensure_ascii=False), encoding="utf-8")
        return
    if path.suffix != ".nc":
        raise RecordingError(f"{path}: notes and tags are kept in .nc files; save it as one first")
    recording = read(path)
    recording.attrs |= new
    save_recording(recording, path)
