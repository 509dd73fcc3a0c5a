"""Recordings as NeXus files: read back, and judged by nexusformat, a program of the NeXus community."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.recording import RecordingError, make_recording, open_recording, save_nexus
from stickslip.recording.calibration import Calibration, apply_calibration

ROOT = Path(__file__).resolve().parents[2]
# Runs in the environment of others' programs: counts what breaks the definitions of NeXus, finds the plot.
JUDGE = """
import contextlib, io, json, sys
import nexusformat.nexus as nx
found = []
for path in sys.argv[1:]:
    root = nx.nxload(path)
    with contextlib.redirect_stdout(io.StringIO()):
        counts = list(root.check())
        groups = root["entry"].get("calibrations", {})
        of_calibrations = [list(groups[name].check()) for name in groups]
    try:
        data = root.plottable_data
        y, x = data.nxsignal, data.nxaxes[0]
        shown = [y.nxname, y.units, y.nxdata.tolist(), x.nxdata.tolist()]
    except (nx.NeXusError, AttributeError):
        shown = []
    found.append({"counts": counts, "calibrations": of_calibrations, "shown": shown})
print(json.dumps(found))
"""
NAMES = {
    "drive_voltage": ["V", "mV"],
    "end_effector_position": ["m", "um", "rad", "deg"],
    "stage_position": ["nm", "urad"],
    "position_2": ["mm"],
    "friction_force": ["N", "N m"],
    "temperature": ["degC", "K"],
    "monitor": ["A", "V"],
    "ratio": [""],
    "damping": ["N s/m"],
}


def judged(*paths: Path) -> list[dict]:
    python = ROOT / ".venv-drivers" / "bin" / "python"
    done = subprocess.run([python, "-c", JUDGE, *paths], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def random_recording(rng: np.random.Generator) -> xr.Dataset:
    """With gaps in time, in several units, of a stage that moves or turns, perhaps calibrated."""
    count = int(rng.integers(2, 400))
    time = rng.uniform(-1.0, 1.0) + np.cumsum(rng.choice([1e-4, 1e-4, 1e-4, 0.3], count))
    names = rng.permutation(list(NAMES))[: rng.integers(1, len(NAMES) + 1)]
    variables = {str(name): (rng.normal(size=count), str(rng.choice(NAMES[name]))) for name in names}
    variables |= {"sensor": (rng.uniform(0.5, 2.0, count), "V")}
    texts = {"title": "Walk at 65 V, 5 µm", "notes": "first line\nsecond", "processing": "dropped 3 samples"}
    said = {name: text for name, text in texts.items() if rng.random() < 0.6}
    epoch = "2026-02-03T04:05:06+00:00" if rng.random() < 0.5 else ""
    made = make_recording(time, variables, epoch=epoch, source="walk.csv", **said)
    if rng.random() < 0.5:
        polynomial = Calibration("ours", (1e-6, 2e-6, -3e-8), "V", "m", 0.0, 3.0, scale_uncertainty=0.002)
        made = apply_calibration(made, {"sensor": [polynomial]}, {"sensor": "calibrated_position"})
    made.attrs |= {"drive": '{"waveform": "Sawtooth", "amplitude": 65.0}', "repeat": 3, "temperature": 293.15}
    return made


def test_random_recordings_are_valid_and_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(55)
    made = [random_recording(rng) for _ in range(24)]
    paths = [save_nexus(one, tmp_path / f"{k}.nxs") for k, one in enumerate(made)]
    for recording, path, seen in zip(made, paths, judged(*paths), strict=True):
        again = open_recording(path)
        assert again.identical(recording)
        assert list(again.data_vars) == list(recording.data_vars)
        assert ss.read_recording(path).identical(recording)
        assert seen["counts"] == [0, 0]
        calibrated = "calibrated_position" in recording
        assert seen["calibrations"] == [[0, 0]] * calibrated
        signal, *shown = seen["shown"]
        values = recording[signal].values.tolist()
        assert shown == [recording[signal].attrs["units"], values, recording["time"].values.tolist()]
        positions = {str(name) for name in recording.data_vars if "position" in str(name).split("_")}
        with h5py.File(path) as file:
            tools = file["entry"].get("instrument", {})
            of_class = {n for n in tools if tools[n].attrs.get("NX_class") == "NXpositioner"}
        assert of_class == positions
        assert not positions or signal in positions
    assert {len(one.data_vars) for one in made} > {2, 5, 9}


def test_the_judge_notices_what_is_wrong(tmp_path: Path) -> None:
    made, paths = make_recording([0.0, 1.0], {"position": [1.0, 2.0]}), []
    for wrong in ("yesterday", "nothing", "NXmagic", "colour"):
        paths.append(save_nexus(made, tmp_path / f"{wrong}.nxs"))
        with h5py.File(paths[-1], "r+") as file:
            if wrong == "yesterday":
                file["entry/start_time"] = wrong
            elif wrong == "nothing":
                file["entry/data"].attrs["signal"] = wrong
            elif wrong == "NXmagic":
                file.create_group("entry/magic").attrs["NX_class"] = wrong
            else:
                file["entry/instrument/position/colour"] = "red"
    for path, seen in zip(paths, judged(*paths), strict=True):
        assert sum(seen["counts"]) > 0, path.name


def test_moments_and_calibration_in_the_words_of_nexus(tmp_path: Path) -> None:
    time = np.array([0.5, 1.0, 2.5])
    made = make_recording(time, {"sensor": (time, "V")}, epoch="2026-02-03T04:05:06+00:00", title="Walk")
    line = Calibration("line", (1e-6, 2e-6), "V", "m", 0.0, 5.0, source="bench 2")
    path = save_nexus(apply_calibration(made, {"sensor": [line]}, {"sensor": "position"}), tmp_path / "a.nxs")
    with h5py.File(path) as file:
        entry = file["entry"]
        assert entry["start_time"].asstr()[()] == "2026-02-03T04:05:06.500000+00:00"
        assert entry["end_time"].asstr()[()] == "2026-02-03T04:05:08.500000+00:00"
        assert entry["title"].asstr()[()] == "Walk"
        assert entry["instrument/position/value"] == entry["data/position"]
        one = entry["calibrations/position_1"]
        assert one["fit_formula_description"].asstr()[()] == "a0 + a1 * x"
        assert [one[f"calibration_parameters/a{k}"][()] for k in (0, 1)] == [1e-6, 2e-6]
        np.testing.assert_allclose(one["calibrated_axis"][()], 1e-6 + 2e-6 * one["original_axis"][()])
        assert (one["original_axis"].attrs["units"], one["calibrated_axis"].attrs["units"]) == ("V", "m")


def test_a_renamed_file_is_ours_too(tmp_path: Path) -> None:
    made = make_recording([0.0, 1.0, 3.0], {"position": [1.0, 2.0, 3.0]})
    path = save_nexus(made, tmp_path / "a.nxs").rename(tmp_path / "a.h5")
    assert ss.read_recording(path).identical(made)


def test_refused(tmp_path: Path) -> None:
    def saved(name: str = "a.nxs", variable: str = "position", **attrs: object) -> None:
        made = make_recording([0.0, 1.0], {variable: [1.0, 2.0]})
        save_nexus(made.assign_attrs(attrs), tmp_path / name)

    for arguments, message in (
        ({"name": "a.nc"}, r"must end in \.nxs"),
        ({"variable": "größe"}, r"'größe' is no name in NeXus: rename it with ASCII"),
        ({"variable": "force_errors"}, "meaning of its own"),
        ({"NX_class": "mine"}, "'NX_class' is one of NeXus"),
        ({"links": {}}, "is a dict"),
    ):
        with pytest.raises(RecordingError, match=message):
            saved(**arguments)
        assert not list(tmp_path.iterdir())


def test_what_is_not_whole_is_refused(tmp_path: Path) -> None:
    path = save_nexus(make_recording([0.0, 1.0], {"position": [1.0, 2.0]}), tmp_path / "a.nxs")
    with h5py.File(path, "r+") as file:
        del file["entry/data"]
    with pytest.raises(RecordingError, match="no NeXus file of stickslip: it lacks the group /entry/data"):
        open_recording(path)
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(RecordingError, match="cut off or damaged"):
        open_recording(path)
