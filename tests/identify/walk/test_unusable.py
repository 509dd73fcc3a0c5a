"""Recordings that nothing can be learned from: each kind has a refusal of its own, wherever it comes in."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml
from typer.testing import CliRunner

from identify.step_system import step_recording
from stickslip.cli import app
from stickslip.identify.events.sawtooth import sawtooth_features
from stickslip.identify.recorded.channels import refuse_clipped
from stickslip.identify.step.fit import identify_step
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError
from stickslip.recording import RecordingError, make_recording
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest

PERIOD, BEGIN = 0.05, 0.1
DRIVE = Sequence(Rest(BEGIN), Sawtooth(65.0, 1.0 / PERIOD, periods=8))
MODEL = load_actuator("kang2007").replace(stage_reaction=False)
FREE = ["sigma_0", "sigma_1", "coulomb_force"]


def walk() -> xr.Dataset:
    """A staircase with noise: what is refused is refused before any simulation."""
    t = np.arange(2400) * 0.25e-3
    part = np.clip((t - BEGIN) / PERIOD, 0.0, 8.0)
    x = 6.6e-6 * part - 4.3e-6 * np.floor(part) + 2e-8 * np.random.default_rng(0).standard_normal(t.size)
    return make_recording(t, {"end_effector_position": x, "drive_voltage": DRIVE.value(t)}, title="walk")


def step() -> xr.Dataset:
    return step_recording(60.0, 2e-8).assign_attrs(title="step")


def _with(recording: xr.Dataset, position: np.ndarray) -> xr.Dataset:
    data = ("time", position, recording["end_effector_position"].attrs)
    return recording.assign(end_effector_position=data)


def empty(recording: xr.Dataset) -> xr.Dataset:
    return recording.isel(time=slice(0, 0))


def constant(recording: xr.Dataset) -> xr.Dataset:
    return _with(recording, np.full(recording.sizes["time"], 3e-6))


def clipped(recording: xr.Dataset) -> xr.Dataset:
    return _with(recording, np.minimum(recording["end_effector_position"].values, 6.2e-6))


def short(recording: xr.Dataset) -> xr.Dataset:
    """Until shortly after the drive begins."""
    after = float(recording["time"][int(np.argmax(recording["drive_voltage"].values > 0.0))])
    return recording.sel(time=slice(0.0, after + 2e-3))


def coarse(recording: xr.Dataset) -> xr.Dataset:
    """Six samples a period; a natural period of the stage between two samples."""
    return recording.isel(time=slice(0, None, 34))


POSITION = r"end_effector_position \[m\] of "
WORDS = {
    empty: POSITION + r"{} is empty; at least 10 samples are needed",
    constant: POSITION + r"{} is 3e-06 throughout",
    clipped: POSITION + r"{} is clipped: it stays at its greatest value, 6.2e-06, for .* samples .*range",
    short: r"too short.* (is|are) needed",
    coarse: POSITION + r"{} is too coarsely sampled: .*; at least \d+ are needed",
}
KINDS = pytest.mark.parametrize("spoil", WORDS, ids=lambda spoil: spoil.__name__)


def said(spoil: Callable, name: str) -> str:
    return WORDS[spoil].format(name)


@KINDS
def test_steps(spoil) -> None:
    with pytest.raises(RecordingError, match=said(spoil, "step")):
        identify_step(spoil(step()))


@KINDS
def test_walks(spoil) -> None:
    with pytest.raises(RecordingError, match=said(spoil, "walk")):
        identify_friction(spoil(walk()), MODEL, FREE, drive=DRIVE)


@pytest.mark.parametrize("period", [80, 400])
def test_coarse_levels_are_not_taken_for_a_clipped_sensor(period: int) -> None:
    """They hide a turn, of a sawtooth or a sine, for some samples; a sensor at its end stays far longer."""
    t = np.arange(2000) / period
    for shape in (t % 1.0, np.abs(2.0 * (t % 1.0) - 1.0), np.sin(2.0 * np.pi * t)):
        for step in np.linspace(0.005, 0.08, 12):
            read = step * np.round((shape + 0.3 * t / t[-1]) / step)
            refuse_clipped(read, "end_effector_position", "walk")
            if step > 0.03:
                continue
            cut = np.clip(read, None, step * round(0.5 / step))
            with pytest.raises(RecordingError, match="walk is clipped"):
                refuse_clipped(cut, "end_effector_position", "walk")


@pytest.mark.parametrize("rate", [1e-2, 5e-2])
def test_what_settles_at_a_level_is_not_taken_for_a_clipped_sensor(rate: float) -> None:
    n = np.arange(int(40.0 / rate))
    for share in np.linspace(0.0, 1.0, 4):
        for step in (1e-3, 1e-2, 5e-2):
            settled = (1.0 + share * step) * (1.0 - np.exp(-rate * n))
            refuse_clipped(step * np.round(settled / step), "end_effector_position", "step")
            cut = np.clip(settled, None, 0.6)
            if step < 2e-2:
                with pytest.raises(RecordingError, match="step is clipped"):
                    refuse_clipped(step * np.round(cut / step), "end_effector_position", "step")


@pytest.mark.parametrize("limits", [(2e-6, 15e-6)])
def test_a_converter_may_cut_the_last_change_too(limits: tuple[float, float]) -> None:
    cut = _with(walk(), np.clip(walk()["end_effector_position"].values, *limits))
    with pytest.raises(RecordingError, match="walk is clipped"):
        identify_friction(cut, MODEL, FREE, drive=DRIVE)


@KINDS
def test_features(spoil) -> None:
    with pytest.raises(RecordingError, match=said(spoil, "walk")):
        sawtooth_features(spoil(walk()))


def as_csv(recording: xr.Dataset, path: Path) -> None:
    columns = ("time", "end_effector_position", "drive_voltage")
    rows = zip(*(recording[name].values.tolist() for name in columns), strict=True)
    path.write_text("\n".join(["t [s],x [m],u [V]", *(",".join(map(repr, row)) for row in rows)]), "utf-8")


def from_begin(recording: xr.Dataset) -> xr.Dataset:
    """What comes once the drive has begun, from time zero on."""
    later = recording.sel(time=slice(BEGIN, None))
    return later.assign_coords(time=later["time"] - BEGIN)


COLUMNS = {"time": "t", "end_effector_position": "x", "drive_voltage": "u"}
WAVEFORM = {"shape": "Sawtooth", "fields": {"amplitude": "65 V", "frequency": "20 Hz", "periods": 8}}


def campaign(use: str) -> dict:
    """A campaign of which the one recording is spoilt that is used so."""
    parts = {
        "step": {"file": "step.csv", "waveform": [{"shape": "Step", "fields": {"amplitude": "60 V"}}]},
        "fit": {"file": "walk.csv", "waveform": [WAVEFORM]},
        "verify": {"file": "other.csv", "waveform": [WAVEFORM]},
    }
    first = {"columns": COLUMNS, "use": use, **parts.pop(use)}
    others = [{"columns": COLUMNS, "use": name, **part} for name, part in parts.items()]
    return {"title": "A campaign", "recordings": [first, *others]}


WALK_STUDY = {
    "kind": "walk",
    "title": "A walk",
    "model": "kang2007",
    "free": FREE,
    "recordings": [
        {
            "file": "walk.csv",
            "columns": COLUMNS,
            "drive": {"shape": "Sawtooth", "fields": WAVEFORM["fields"]},
        }
    ],
}
FILES = {
    "campaign step": ("campaign", campaign("step"), "step"),
    "campaign fit": ("campaign", campaign("fit"), "walk"),
    "campaign verify": ("campaign", campaign("verify"), "other"),
    "identify": ("identify", WALK_STUDY, "walk"),
}


@pytest.mark.parametrize(("spoil", "of"), [*zip(WORDS, [*FILES, "identify"], strict=True)])
def test_commands_fail_and_keep_what_was_there(tmp_path: Path, spoil, of: str):
    command, content, name = FILES[of]
    for good in ("walk", "other", "step"):
        recording = step() if good == "step" else walk()
        recording = spoil(recording) if good == name else recording
        as_csv(from_begin(recording) if command == "identify" else recording, tmp_path / f"{good}.csv")
    (tmp_path / "file.yaml").write_text(yaml.safe_dump(content), "utf-8")
    out = tmp_path / "out"
    out.mkdir()
    (out / "results.json").write_text(json.dumps({"earlier": 1}), "utf-8")
    done = CliRunner().invoke(app, [command, str(tmp_path / "file.yaml"), "--out", str(out)])
    assert done.exit_code == 2
    last = done.stderr.splitlines()[-1]
    assert last.startswith("Error: ")
    assert f"{name}.csv" in last or f" of {name} " in last
    words = {
        empty: "there are no rows of numbers",
        constant: "throughout",
        short: r"too short|has \d+ samples; at least 10",
    }
    assert re.search(words.get(spoil, spoil.__name__), last), last
    assert json.loads((out / "results.json").read_text("utf-8")) == {"earlier": 1}
    assert {p.name for p in out.iterdir()} == {"results.json"}


def test_a_table_and_bounds_in_the_wrong_order_are_named() -> None:
    with pytest.raises(RecordingError, match="a DataFrame is no recording: make_recording makes one"):
        identify_friction(pd.DataFrame({"x": [0.0]}), MODEL, ["sigma_0"])
    bounds = {"sigma_0": ("2 N/um", "1 N/um")}
    with pytest.raises(QuantityError, match=r"bounds of sigma_0 = \('2 N/um', '1 N/um'\): the lower one"):
        identify_friction(walk(), MODEL, ["sigma_0"], drive=DRIVE, bounds=bounds)
