"""Routes of the Design page: against the package's own calls, and for wrong requests."""

from __future__ import annotations

import threading
from typing import Any

import httpx
import numpy as np
import pytest

import stickslip as ss
from stickslip.panel import designing
from stickslip.panel.design import bench_run
from stickslip.panel.designing import DesignedDrive, from_lowest
from stickslip.panel.sliders import choices

from .serving import heard, streaming
from .test_stream import unpacked

KANG = choices()["sets"]["kang2007"]
MODEL: dict[str, Any] = {"set": "kang2007", "law": "LuGre", "friction": KANG["friction"]["LuGre"]}
SAWTOOTH = {"shape": "Sawtooth", "fields": {"amplitude": 65.0, "frequency": 5.0}}


def test_the_map_is_that_of_step_map(client: httpx.Client) -> None:
    asked = MODEL | {"voltage": "80 V", "load": -0.05}
    header, arrays = unpacked(client.post("/api/design/map", json=asked).content)
    of = dict(zip(header["names"], arrays, strict=True))
    model = ss.load_actuator("kang2007")
    steps = of["net_step"].reshape(of["voltage"].size, of["frequency"].size)
    for i, k in ((32, 0), (20, 11), (10, 35)):
        drive = ss.Sawtooth(float(of["voltage"][i]), float(of["frequency"][k]))
        assert steps[i, k] == pytest.approx(
            ss.steady_step(model.replace(external_force=-0.05), drive), abs=3e-9
        )
    assert np.all(of["status"] == 0)


def test_a_motion_goes_over_two_periods(client: httpx.Client) -> None:
    header, arrays = unpacked(client.post("/api/design/motion", json=MODEL | {"drive": SAWTOOTH}).content)
    time, volts, moved = arrays
    step = ss.steady_step(ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 5.0))
    assert time[[0, -1]] == pytest.approx([0.0, 0.4])
    assert moved[[0, time.size // 2, -1]] == pytest.approx([0.0, step, 2 * step], abs=2e-10)
    assert header["speed"] == pytest.approx(5.0 * step, rel=1e-3)
    assert volts[: time.size // 2].max() == pytest.approx(65.0, rel=1e-6)


def test_a_search_that_is_stopped_gives_the_best_until_then(client: httpx.Client) -> None:
    answers: list[httpx.Response] = []
    asked = MODEL | {"voltage": 100.0, "spread": 0.1, "knots": 32}

    def search() -> None:
        answers.append(client.post("/api/design/search", json=asked))

    with streaming(client) as stream:
        going = threading.Thread(target=search)
        going.start()
        while heard(stream, "design")["share"] < 0.12:
            pass
        second = client.post("/api/design/search", json=asked)
        assert second.status_code == 422
        assert "a search is going on" in second.json()["error"]
        client.post("/api/design/stop", json={})
        going.join()
    found = answers[0].json()
    assert found["interrupted"]
    assert found["value"] >= found["sawtooth_value"]
    assert len(found["conditions"]) == 3


def test_a_search_within_generator_and_amplifier(client: httpx.Client) -> None:
    output = {
        "update_rate": "10 kHz",
        "points": 100,
        "step": "1 V",
        "current": "0.2 A",
        "capacitance": "1 uF",
    }
    asked = {"voltage": 100.0, "knots": "4", "output": output}
    answer = client.post("/api/design/search", json=MODEL | asked)
    found = ss.optimise_waveform(
        ss.load_actuator("kang2007"), goal="speed", knots=4, max_voltage=100.0,
        output=ss.physics.electronics.OutputStage(1e4, 100, 1.0, current=0.2, capacitance=1e-6),
    )  # fmt: skip
    assert answer.json()["value"] == pytest.approx(found.value, rel=1e-9)
    assert len(answer.json()["drive"]["fields"]["values"]) == 4


def test_what_is_not_told_is_said_of_each_parameter(client: httpx.Client) -> None:
    """At 1 V the end-effector hardly slips: how it is damped then is not told, the stage is, roughly."""
    drive = {"shape": "Sawtooth", "fields": {"amplitude": 1.0, "frequency": 50.0}}
    rows = client.post("/api/design/tells", json=MODEL | {"drive": drive, "noise": 1e-7}).json()["parameters"]
    told = {row["name"]: row["half_width"] for row in rows}
    assert told["sigma_1"] is None
    assert told["natural_frequency"] < 0.5
    assert next(row["default_half_width"] for row in rows if row["name"] == "coulomb_force") < 1.0


@pytest.mark.parametrize(
    ("path", "change", "words"),
    [
        ("search", {"voltage": 100.0, "knots": 1}, "knots"),
        ("search", {"voltage": 100.0, "output": {"points": 100}}, "update_rate [Hz] is missing"),
        ("search", {"voltage": 100.0, "output": {"step": "1 V"}}, "update_rate [Hz] is missing"),
        ("search", {"voltage": 100.0, "output": {"update_rate": "1 V"}}, "update_rate"),
        ("search", {"voltage": 100.0, "output": {"current": "1 V"}}, "current"),
        ("map", {"voltage": "5 N"}, "voltage"),
        ("map", {"voltage": 0.0}, "voltage"),
        ("search", {"voltage": 100.0, "spread": -1.0}, "spread of the load"),
        ("search", {"voltage": 300.0}, "out of range"),
        ("front", {"voltage": 100.0, "output": {"capacitance": "1 V"}}, "capacitance"),
        ("front", {"voltage": 100.0}, "capacitance"),
        ("check", {"name": "volume", "value": 1.0}, "there is no field 'volume'"),
        ("check", {"name": "points", "value": 2}, "points"),
        ("motion", {"drive": {"shape": "Sawtooth", "fields": {"amplitude": 5.0}}}, "frequency"),
        (
            "motion",
            {"drive": {"shape": "Sawtooth", "fields": {"amplitude": 5.0, "frequency": -1}}},
            "frequency",
        ),
        ("tells", {"drive": SAWTOOTH, "noise": -1.0}, "noise"),
        ("map", {"voltage": 50.0, "set": "nothing"}, "nothing"),
    ],
)
def test_wrong_values_are_named(client: httpx.Client, path: str, change: dict[str, Any], words: str) -> None:
    answer = client.post(f"/api/design/{path}", json=MODEL | change)
    assert answer.status_code in (400, 422)
    assert words in answer.json()["error"]


def test_a_drive_is_sent_as_a_run_that_begins_where_it_is_lowest() -> None:
    knots = {"times": [0.0, 1e-3, 3e-3], "values": [40.0, 90.0, 10.0], "period": 4e-3}
    drive = DesignedDrive(shape="PeriodicKnots", fields=knots)  # type: ignore[arg-type]
    turned = from_lowest(drive.waveform())
    at = np.linspace(0.0, 4e-3, 50)
    assert turned.values[0] == 10.0
    assert turned.value(at) == pytest.approx(drive.waveform().value(at + 3e-3), abs=1e-9)
    run = bench_run(drive, [{"capture": {"interval": "0.25 ms"}}, {"capture": {"interval": "50 us"}}])
    assert run["capture"]["interval"] == "50 us"
    assert run["waveform"][0]["fields"]["periods"] == 25


def test_a_sent_drive_is_on_the_bench_once(client: httpx.Client) -> None:
    with streaming(client) as stream:
        heard(stream, "experiment")
        for _ in range(2):
            assert client.post("/api/design/send", json=SAWTOOTH).json() == {"run": "designed"}
            runs = heard(stream, "experiment")["content"]["runs"]
    assert [one["name"] for one in runs].count("designed") == 1
    beyond = {"shape": "Sawtooth", "fields": {"amplitude": 140.0, "frequency": 5.0}}
    refused = client.post("/api/design/send", json=beyond)
    assert refused.status_code in (400, 422)
    assert "100 V" in refused.json()["error"]


def test_a_map_that_takes_too_long_is_left_out(client: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(designing, "MAP_SECONDS", 0.0)
    asked = {**MODEL, "voltage": 80.0}
    header, arrays = unpacked(client.post("/api/design/map", json=asked).content)
    grid = dict(zip(header["names"], arrays, strict=True))
    assert (grid["in_time"][0], grid["net_step"].size) == (0.0, grid["voltage"].size * grid["frequency"].size)
    there = np.isfinite(grid["status"]).reshape(grid["voltage"].size, -1)
    assert there[: designing.ROWS].all()
    assert not there[designing.ROWS :].any()
