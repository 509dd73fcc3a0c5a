"""What the index keeps of a file, read from the file."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import xarray as xr

from ..recording import RecordingError, open_recording
from ..recording.storage import save_recording

RECORDINGS = (".nc", ".csv", ".mat", ".npz", ".npy", ".tsv", ".txt")


def described(recording: xr.Dataset) -> dict[str, Any]:
    """The columns of a recording, but for its name and size.

    `settings` is what makes it: drive, capture, limits, variables of the experiment, and the actuator as the
    file says it.
    """
    attrs = {str(name): value for name, value in recording.attrs.items()}
    time = recording["time"].values
    settings = {name: _read(attrs[name]) for name in ("variables", "capture", "limits") if attrs.get(name)}
    settings |= {name: str(attrs[name]) for name in ("drive", "actuator") if attrs.get(name)}
    named = re.search(r"\bname='([\w.-]+)'", str(attrs.get("actuator", "")))
    return {
        "begun": str(attrs.get("epoch", "")),
        "title": str(attrs.get("title", "")),
        "notes": str(attrs.get("notes", "")),
        "tags": str(attrs.get("tags", "")),
        "operator": str(attrs.get("operator", "")),
        "rig": str(attrs.get("source", "")),
        "parameter_set": named[1] if named else "",
        "outcome": str(attrs.get("outcome", "")),
        "seconds": float(time[-1] - time[0]),
        "samples": int(time.size),
        "channels": ", ".join(str(name) for name in recording.data_vars),
        "settings": json.dumps(settings, ensure_ascii=False),
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
    return {
        "begun": str(results.get("created", "")),
        "title": str(results.get("title", "")),
        "notes": " ".join(str(results.get("summary", "")).split())[:500],
        "parameter_set": str(request.get("set", "")),
        "outcome": str(state.get("phase", "complete")).replace("done", "complete"),
        "settings": json.dumps(results.get("numbers", {}), ensure_ascii=False),
        "links": json.dumps({name: given for name, given in links.items() if given}, ensure_ascii=False),
    }


def _read(text: object) -> Any:
    try:
        return json.loads(str(text))
    except ValueError:
        return str(text)


def annotate(path: Path, notes: str | None = None, tags: list[str] | None = None) -> None:
    """Change the notes or the tags that a recording keeps; the file is replaced as a whole.

    Raises:
        RecordingError: it is no .nc file, or cannot be read.
    """
    if path.suffix != ".nc":
        raise RecordingError(f"{path}: notes and tags are kept in .nc files; save it as one first")
    recording = open_recording(path)
    if notes is not None:
        recording.attrs["notes"] = notes
    if tags is not None:
        recording.attrs["tags"] = ", ".join(sorted({tag.strip() for tag in tags} - {""}))
    save_recording(recording, path)
