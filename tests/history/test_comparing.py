"""Runs beside each other: on what their clocks are aligned, what is said of it, and of what differs."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip.history import differences
from stickslip.history.comparing import DRIVE, TRIGGER, common_zeros, comparable
from stickslip.history.describing import described
from stickslip.history.storable import storable_row
from stickslip.history.wording import worded

LEVEL = {"signal": "drive_voltage", "level": 1.0, "edge": "rising"}


def walk(begin: float, capture: dict | None = None, drive: bool = True, interval: float = 1e-3) -> xr.Dataset:
    """A position that follows a drive from 0 to 40 V, which begins at `begin` [s]."""
    time = np.arange(0.0, 1.0, interval)
    volts = 40.0 * np.clip(time - begin, 0.0, None)
    channels = {"drive_voltage": (volts, "V")} if drive else {}
    made = ss.make_recording(time, {**channels, "end_effector_position": (1e-7 * volts, "m")})
    if capture is not None:
        made.attrs["capture"] = json.dumps(capture)
    return made


def test_two_that_were_triggered_begin_at_their_triggers() -> None:
    zeros = common_zeros(
        [
            walk(0.175, {"pre_trigger": 0.2, "trigger": LEVEL}),
            walk(0.275, {"pre_trigger": 0.3, "trigger": LEVEL}),
        ]
    )
    assert [(zero.event, zero.time) for zero in zeros] == [(TRIGGER, 0.2), (TRIGGER, 0.3)]
    assert comparable(zeros) == [True, True]


def test_beside_one_without_a_trigger_all_begin_with_their_drives() -> None:
    """The trigger at 1 V is 25 ms behind the begin of this drive: one may not stand for the other."""
    triggered, own = walk(0.175, {"pre_trigger": 0.2, "trigger": LEVEL}), walk(0.4)
    zeros = common_zeros([triggered, own])
    assert [zero.event for zero in zeros] == [DRIVE, DRIVE]
    assert [zero.triggered for zero in zeros] == [True, False]
    np.testing.assert_allclose([zero.time for zero in zeros], [0.175, 0.4], atol=1.01e-3)  # a sample


def test_what_shows_no_common_zero_is_not_subtracted() -> None:
    silent = walk(0.4, drive=False)
    zeros = common_zeros([walk(0.2), silent, walk(0.3)])
    assert [zero.event for zero in zeros] == [DRIVE, "", DRIVE]
    assert comparable(zeros) == [True, False, True]
    assert zeros[1].time == 0.0
    assert comparable(common_zeros([silent, walk(0.2), silent])) == [False, False, False]
    # A trigger without a drive, and a drive without a trigger.
    by_trigger = walk(0.2, {"pre_trigger": 0.2, "trigger": LEVEL}, drive=False)
    zeros = common_zeros([by_trigger, walk(0.3)])
    assert [zero.event for zero in zeros] == [TRIGGER, DRIVE]
    assert comparable(zeros) == [True, False]


def test_a_capture_without_a_trigger_and_a_simulation_begin_with_their_drives() -> None:
    free = walk(0.0, {"pre_trigger": 0.0, "trigger": None})  # it moves from the first sample on
    simulated = ss.simulate(
        ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 5.0), duration=0.2, sample_rate=2e3
    )
    zeros = common_zeros([free, simulated])
    assert [tuple(zero) for zero in zeros] == [(0.0, DRIVE, False)] * 2


@pytest.mark.parametrize("text", ["[]", "no json", '{"pre_trigger": "late"}', "3"])
def test_a_damaged_capture_is_as_none(text: str) -> None:
    recording = walk(0.25).assign_attrs(capture=text)
    assert [zero.event for zero in common_zeros([recording, recording])] == [DRIVE, DRIVE]


def test_what_differs_is_said_in_words_with_units() -> None:
    def row(*args: object, **capture: object) -> dict:
        made = walk(0.2, {"pre_trigger": 0.1, "trigger": LEVEL, **capture}, *args)  # type: ignore[arg-type]
        of = "Actuator(name='kang2007')" if not args else ""
        return storable_row(described(made.assign_attrs(actuator=of)))

    rows = [row(), row(False, 5e-4, trigger={**LEVEL, "level": 2.5}, pre_trigger=0.2)]
    said = {one["what"]: one for one in worded(differences(rows), rows)}
    assert said["length"]["units"] == ["s", "s"]
    assert said["length"]["values"] == pytest.approx([0.999, 0.9995])
    assert (said["parameter set"]["values"], said["parameter set"]["units"]) == (["kang2007", ""], ["", ""])
    assert said["channels"]["values"] == ["drive voltage, end effector position", "end effector position"]
    assert (said["capture: pre trigger"]["values"], said["capture: pre trigger"]["units"]) == (
        [0.1, 0.2],
        ["s", "s"],
    )
    assert said["capture: trigger: level"]["units"] == ["V", "V"]


def test_an_estimate_is_said_with_its_unit() -> None:
    def fit(value: float) -> dict:
        numbers = {"parameters": {"sigma_0": {"value": value, "unit": "N/m", "low": 1.0, "high": 2.0}}}
        return {"settings": json.dumps(numbers)}

    rows = [fit(1.2), fit(1.4)]
    assert worded(differences(rows), rows) == [
        {"what": "parameters: sigma_0", "values": [1.2, 1.4], "units": ["N/m", "N/m"]}
    ]


def test_a_file_that_was_taken_in_has_a_source_and_no_rig(tmp_path: Path) -> None:
    (tmp_path / "of_another_lab.csv").write_text("time [s],force [mN]\n0,1\n1,2\n2,3\n")
    ss.save_recording(ss.read_recording(tmp_path / "of_another_lab.csv"), tmp_path / "taken.nc")
    table = ss.history.runs(tmp_path).set_index("name")
    assert table.loc["taken.nc", "rig"] == ""
    assert table.loc["taken.nc", "settings"] == {"source": "of_another_lab.csv"}


def test_a_fit_with_failures_is_not_called_complete(tmp_path: Path) -> None:
    for name, failures in [("good", []), ("bad", ["the model does not explain a.nc", "r² is 0.7"])]:
        fit = tmp_path / "fits" / name
        fit.mkdir(parents=True)
        results = {"title": "Identification", "made": "2026-01-03T10:00:00+00:00", "failures": failures}
        (fit / "results.json").write_text(json.dumps(results))
        (fit / "report.html").write_text("")
        (fit / "shown.json").write_text(json.dumps({"phase": "done", "request": {}}))
    table = ss.history.runs(tmp_path).set_index("name")
    assert table.loc["fits/good", "outcome"] == "complete"
    assert table.loc["fits/bad", "outcome"] == ("not as required: the model does not explain a.nc; r² is 0.7")
    assert list(ss.history.runs(tmp_path, outcome="not as required")["name"]) == ["fits/bad"]
    assert set(table["begun"]) == {"2026-01-03T10:00:00+00:00"}, "when it was made, not when it was annotated"
