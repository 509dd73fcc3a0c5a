"""MDF 4 files whose blocks name each other in circles, unpack to more than they say, or hold formulas."""

from __future__ import annotations

import struct
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from asammdf.blocks.v4_blocks import ChannelConversion

from stickslip.gate.limits import LIMITS
from stickslip.recording import RecordingError
from stickslip.recording.readers import read_recording

TIME = np.arange(200) * 1e-3


def written(path: Path, *, compression: Any = 0, **channel: object) -> bytearray:
    with MDF(version="4.10") as made:
        made.append([Signal(TIME * 60, TIME, "V", "volts", **channel)])  # type: ignore[arg-type]
        made.save(path, overwrite=True, compression=compression)
    return bytearray(path.read_bytes())


def refused(path: Path, content: bytes | bytearray, match: str) -> None:
    path.write_bytes(content)
    begun = time.thread_time()
    with pytest.raises(RecordingError, match=rf"a\.mf4: .*{match}"):
        read_recording(path)
    assert time.thread_time() - begun < 5.0


@pytest.mark.parametrize(("kind", "link"), [(b"##CN", 0), (b"##CN", 1), (b"##CG", 0), (b"##DG", 0)])
def test_a_circle_is_refused(tmp_path: Path, kind: bytes, link: int) -> None:
    content = written(tmp_path / "a.mf4")
    at = content.index(kind)
    content[at + 24 + 8 * link : at + 32 + 8 * link] = struct.pack("<Q", at)
    refused(tmp_path / "a.mf4", content, "in a circle")


def test_numbers_in_a_circle_are_refused(tmp_path: Path) -> None:
    content = written(tmp_path / "a.mf4")
    data = content.index(b"##DG") + 24 + 16
    content[data : data + 8] = struct.pack("<Q", len(content))
    content += struct.pack("<4s4xQQQQ", b"##DL", 40, 2, len(content), len(content))
    refused(tmp_path / "a.mf4", content, "in a circle")


def test_conversions_of_conversions_are_counted(tmp_path: Path) -> None:
    """12 levels, each with ten links to the one below."""
    content = written(tmp_path / "a.mf4")
    below = 0
    for _ in range(12):
        links = (0, 0, 0, 0, *[below] * 10)
        block = struct.pack("<4s4xQQ14Q", b"##CC", 24 + 14 * 8 + 24, 14, *links) + bytes(24)
        below = len(content)
        content += block
    at = content.index(b"##CN") + 24 + 4 * 8
    content[at : at + 8] = struct.pack("<Q", below)
    refused(tmp_path / "a.mf4", content, f"more than {LIMITS.visits:,} groups")


def test_a_block_that_unpacks_to_more_than_it_says_is_refused(tmp_path: Path) -> None:
    content = written(tmp_path / "a.mf4")
    data = content.index(b"##DG") + 24 + 16
    content[data : data + 8] = struct.pack("<Q", len(content))
    packed = zlib.compress(bytes(50_000_000))
    head = struct.pack("<4s4xQQ2sBBIQQ", b"##DZ", 48 + len(packed), 0, b"DT", 0, 0, 0, 3200, len(packed))
    refused(tmp_path / "a.mf4", content + head + packed, "unpacks to more than the 3,200 bytes")


def test_a_formula_is_not_run(tmp_path: Path) -> None:
    written(tmp_path / "a.mf4", conversion=ChannelConversion(conversion_type=3, formula="9**9**9**9*X"))
    refused(tmp_path / "a.mf4", (tmp_path / "a.mf4").read_bytes(), "'volts' is computed by a formula")


def test_entities_of_xml_are_refused(tmp_path: Path) -> None:
    content = written(tmp_path / "a.mf4")
    refused(tmp_path / "a.mf4", content + b"<!ENTITY a SYSTEM 'file:///etc/passwd'>", "ENTITY")


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_a_good_file_is_read(tmp_path: Path, compression: int) -> None:
    written(tmp_path / "a.mf4", compression=compression)
    np.testing.assert_allclose(read_recording(tmp_path / "a.mf4")["volts"], TIME * 60)
