"""MDF 4 files as asammdf writes them: clocks, units, texts, damage; a look before they are taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal

from stickslip import read_recording
from stickslip.recording import RecordingError
from stickslip.recording.readers.preview import look
from stickslip.recording.readers.process import Reader

TIME = np.arange(200) * 1e-3
VOLTS = np.linspace(0.0, 60.0, 200)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Two groups: drive and position, in µm, at 1 kHz; a temperature and a text five times slower."""
    with MDF(version="4.10") as made:
        made.append([Signal(VOLTS, TIME, "V", "HV command"), Signal(VOLTS / 5, TIME, "um", "runner pos")])
        slow = TIME[::5]
        states = np.array([b"warm"] * slow.size)
        made.append(
            [Signal(20.0 + slow, slow, "degC", "oven"), Signal(states, slow, name="state", encoding="utf-8")]
        )
        made.save(tmp_path / "own.mf4", overwrite=True)
    return tmp_path / "own.mf4"


def test_channels_come_with_unit_and_clock(file: Path) -> None:
    columns = {"drive_voltage": "HV command", "end_effector_position": "runner pos"}
    found = read_recording(file, columns=columns)
    np.testing.assert_allclose(found["time"], TIME, atol=1e-12)
    np.testing.assert_allclose(found["drive_voltage"], VOLTS)
    np.testing.assert_allclose(found["end_effector_position"], VOLTS * 1e-6 / 5)
    assert found.attrs["reader"] == "MDF 4"
    slow = read_recording(file, columns={"temperature": "oven"})
    assert slow.sizes["time"] == 40
    part = read_recording(file, columns=columns, rows=(10, 20))
    np.testing.assert_allclose(part["drive_voltage"], VOLTS[10:20])
    with pytest.raises(RecordingError, match=r"own\.mf4.*state.*no numbers"):
        read_recording(file, columns={"state": "state"})


def test_it_is_looked_at_in_a_process_of_its_own(file: Path) -> None:
    read = Reader()
    try:
        found = read.apply(look, file)
    finally:
        read.close()
    by_name = {one["name"]: one for one in found["columns"] if not one["clock"]}
    assert (by_name["HV command"]["guess"], by_name["HV command"]["unit"]) == ("drive_voltage", "V")
    assert (by_name["runner pos"]["guess"], by_name["runner pos"]["unit"]) == ("end_effector_position", "um")
    assert not by_name["state"]["numeric"]
    assert found["samples"] == 200


@pytest.mark.parametrize("kept", [30, 200, 0.5])
def test_damage_is_one_error(file: Path, tmp_path: Path, kept: float) -> None:
    whole = file.read_bytes()
    damaged = tmp_path / "damaged.mf4"
    damaged.write_bytes(whole[: int(kept * len(whole)) if kept < 1 else int(kept)])
    read = Reader()  # as the panel does: what asammdf leaves behind of a damaged file ends with the process
    try:
        with pytest.raises(RecordingError, match=r"damaged\.mf4"):
            read(damaged)
    finally:
        read.close()
