"""Files that are wrong in ways that a lab's files are: made here, not kept."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from stickslip import make_recording, save_recording


def hanging(path: Path) -> Path:
    """A recording with one damaged length, which the HDF5 library alone would read for ever."""
    time = np.arange(200) / 1e3
    save_recording(make_recording(time, {"drive_voltage": time, "end_effector_position": 1e-6 * time}), path)
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")  # the length of its first object, so that the next one is this one again
    content[heap + 24 : heap + 32] = struct.pack("<Q", 2**64 - 16)
    path.write_bytes(content)
    return path
