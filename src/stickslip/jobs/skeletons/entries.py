"""Text of the entries of recordings in a new input file, with columns, units and drives."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...quantities.units import with_prefix
from ...recording import RecordingError
from ...recording.readers import inspect_file
from ...recording.readers.inspection import Inspection
from ...recording.shown_drive import Drive, flow
from ...recording.taken_drive import TakenDrive, taken_drive

MOVED, DRIVE = "end_effector_position", "drive_voltage"


class Inspected(NamedTuple):
    """Inspection of a recording's file, and the drive recognised in the recording (None if none was)."""

    found: Inspection
    taken: TakenDrive | None

    @property
    def drive(self) -> Drive | None:
        """Return the recording's waveform if its name and fields describe it in a file, else None."""
        waveform: Any = None if self.taken is None else self.taken.waveform
        return waveform if isinstance(waveform, Drive) else None

    @property
    def waveform(self) -> str:
        """Return the line on the drive for the recording's entry in a campaign file.

        The line is the key `waveform`, a comment if no waveform describes the drive completely, or "" if no
        drive was recognised.
        """
        if self.taken is None:
            return ""
        if self.drive is None or not self.taken.whole:
            return f"# drive: {self.taken.said()}"
        return f"waveform: [{flow(self.drive)}] # {self.taken.how}"


def looked_at(file: Path) -> Inspected:
    found = inspect_file(file)
    if found.recording is None:
        raise RecordingError(f"{file}: {found.problem}")
    return Inspected(found, taken_drive(found.recording))


def angles(seen: list[Inspected]) -> bool:
    """Return True if the position in any of the recordings is an angle (in rad)."""
    recordings: list[Any] = [one.found.recording for one in seen]
    return any(one[MOVED].attrs.get("units") == "rad" for one in recordings if MOVED in one)


def entry_of(
    one: Inspected, folder: Path, use: str, needed: Sequence[str] = (MOVED, DRIVE)
) -> tuple[list[str], list[str]]:
    """Return the entry of a recording in an input file, as lines, and sentences on what is missing in it.

    Args:
        one: the recording.
        folder: folder of the input file, to which the recording's path is relative.
        use: use of the recording, such as "fit".
        needed: names of the channels that the analysis needs; a missing one is named in the sentences.
    """
    found = one.found
    where = Path(os.path.relpath(found.path.resolve(), folder.resolve())).as_posix()
    lines = [f"file: {json.dumps(where, ensure_ascii=False)}", f"use: {use}"]
    if found.named:
        lines.append(f"columns: {_mapping(found.named)}")
    if found.clocks:
        lines.append(f"clocks: {_mapping(found.clocks)}")
    if found.units:
        lines.append(f"units: {_mapping(found.units)} # guessed")
    wanted = [name for name in needed if name not in found.recording]  # type: ignore[operator]
    missing = []
    if wanted:
        there = ", ".join(f"{c['name']!r}" for c in found.columns if c["numeric"]) or "its variables"
        lines.append(f"# no column was taken for {' and '.join(wanted)}: name it under columns, of {there}")
        missing.append(f"{found.path}: which column is {' and '.join(wanted)}, of {there}")
    return lines, missing


def listed(lines: list[str]) -> str:
    return "\n".join(f"  {'- ' if i == 0 else '  '}{line}" for i, line in enumerate(lines))


def _mapping(names: Mapping[str, str | int]) -> str:
    return (
        "{" + ", ".join(f"{key}: {json.dumps(text, ensure_ascii=False)}" for key, text in names.items()) + "}"
    )


def shown_value(value: float, unit: str) -> str:
    return with_prefix(float(f"{value:.4g}"), unit).replace("µ", "u")
