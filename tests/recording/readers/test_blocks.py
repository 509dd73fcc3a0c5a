"""Logs in blocks of "key: value"."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.recording import RecordingError, read_log

LINES = """Repeatability of the stage, 2025-01-30
Trial 1 - Forward: Error: 37.48 nm, Time: 0.63 sec
Trial 1 - Backward: Error: -12.1 nm, Time: 0.58 sec
Trial 2 - Forward: Error: 0.021 um, Time: 611 ms
"""
BLOCKS = """=== Trial 1 ===
Error: 37.48 nm
Time: 0.63 s

=== Trial 1 ===
Error: -12.1 nm
Time: 0.58 s

=== Trial 2 ===
Error: 21 nm
Time: 0.611 s
"""
REPEATED = """Trial = 1
Error = 37.48 nm
Time = 0.63 s
Trial = 1
Error = -12.1 nm
Time = 0.58 s
Trial = 2
Error = 21 nm
Time = 0.611 s
"""


@pytest.mark.parametrize("text", [LINES, BLOCKS, REPEATED, BLOCKS.replace("\n\n", "\n---\n")])
def test_blocks_become_a_table(tmp_path: Path, text: str) -> None:
    (tmp_path / "moves.txt").write_text(text)
    table = read_log(tmp_path / "moves.txt")
    np.testing.assert_allclose(table["error"], [37.48e-9, -12.1e-9, 21e-9])
    np.testing.assert_allclose(table["time"], [0.63, 0.58, 0.611])
    np.testing.assert_array_equal(table["trial"], [1, 1, 2])
    assert (table["error"].attrs["units"], table["time"].attrs["units"]) == ("m", "s")
    said = str(ss.inspect_file(tmp_path / "moves.txt"))
    assert "a log of 3 records" in said
    assert "error [m]" in said
    done = CliRunner().invoke(app, ["inspect", str(tmp_path / "moves.txt")])
    assert done.exit_code == 0, done.output
    assert 'stickslip.recording.read_log("moves.txt")' in done.output


def test_what_stands_before_the_keys_is_the_label(tmp_path: Path) -> None:
    (tmp_path / "moves.txt").write_text(LINES)
    labels = list(read_log(tmp_path / "moves.txt")["label"].values)
    assert labels == ["Trial 1 - Forward", "Trial 1 - Backward", "Trial 2 - Forward"]


def test_a_key_that_is_missing_or_in_an_unknown_unit(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("Steps: 3, Load: 5 blocks\nSteps: 4\nSteps: 5, Load: 6 blocks\n")
    table = read_log(tmp_path / "a.txt")
    np.testing.assert_array_equal(table["load"], [5.0, np.nan, 6.0])
    assert table["load"].attrs["units"] == "blocks"


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("Error: 1 nm\nnothing more\n")
    with pytest.raises(RecordingError, match="there are no 2 blocks"):
        read_log(tmp_path / "a.txt")
    (tmp_path / "a.txt").write_text("Error: 1 nm\n\nError: 1 V\n")
    with pytest.raises(RecordingError, match=r"'Error' is in 'V' and in 'm'"):
        read_log(tmp_path / "a.txt")


def test_a_table_with_settings_above_stays_a_table(tmp_path: Path) -> None:
    rows = [f"{k * 1e-3:.3f},{k}" for k in range(50)]
    head = ["Gain: 2 V", "", "Rate: 10 Hz", "Time (s),x (um)"]
    (tmp_path / "a.csv").write_text("\n".join([*head, *rows]) + "\n")
    assert ss.inspect_file(tmp_path / "a.csv").recording is not None
