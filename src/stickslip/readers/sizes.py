"""Limits of size, checked before a file is read, from what it says of itself."""

from __future__ import annotations

import stat
from pathlib import Path

from ..recording import RecordingError

ALWAYS = 256 * 2**20  # bytes that a file may unpack to, however small it is
RATIO = 20  # times its own size, of a large file


def check_regular(path: Path) -> None:
    """Raises RecordingError for what is no plain file: a pipe or a device may never end, or never begin."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise RecordingError(f"{path}: there is no such file ({error.strerror})") from None
    if not stat.S_ISREG(mode):
        raise RecordingError(f"{path}: no plain file")


def allowed_bytes(path: Path) -> int:
    """What the arrays of a file may take in memory, as they are in it."""
    return max(ALWAYS, RATIO * path.stat().st_size)


def check_size(path: Path, declared: int, what: str = "arrays") -> None:
    """Raises RecordingError where a file says that it holds more than it may."""
    allowed = allowed_bytes(path)
    if declared > allowed:
        raise RecordingError(
            f"its {what} would take {declared / 2**20:,.0f} MiB; a file of {path.stat().st_size:,} bytes "
            f"may hold {allowed / 2**20:,.0f} MiB ({RATIO} times its size, and 256 MiB in any case)"
        )
