"""The panel's answers for what turns: those for the same actuator that slides on a radius, in rad and N m."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import stickslip as ss
from rotary.turning import RADIUS, SLIDES, TURNS
from stickslip.panel.fit_request import FitRequest
from stickslip.panel.fitting import fit_recordings
from stickslip.panel.folder import Folder

from .serving import heard, streaming
from .test_stream import unpacked
from .turning import EXPERIMENT, SET, prepare

SLIDING_UNITS = {"m", "N", "kg", "m/s", "m/V", "N/m", "N s/m"}
SAWTOOTH = {"shape": "Sawtooth", "fields": {"amplitude": 65.0, "frequency": 20.0}}


@pytest.fixture(scope="module")
def folder(folder: Path) -> Path:
    prepare(folder, real_time=False)
    return folder


@pytest.fixture(scope="module")
def choices(client: httpx.Client) -> dict[str, Any]:
    return client.get("/api/explore/choices").json()


def model_of(choices: dict[str, Any], name: str) -> dict[str, Any]:
    found = choices["sets"][name]
    return {"set": name, "model": found["model"], "law": "LuGre", "friction": found["friction"]["LuGre"]}


def state_of(choices: dict[str, Any], name: str) -> dict[str, Any]:
    drive = {"amplitude": 65.0, "frequency": 20.0}
    return model_of(choices, name) | {"shape": "Sawtooth", "waveform": drive, "duration": 0.25}


def answered(client: httpx.Client, path: str, asked: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    answer = client.post(path, json=asked)
    assert answer.status_code == 200, answer.text
    header, arrays = unpacked(answer.content)
    return header, dict(zip(header["names"], arrays, strict=True))


def test_its_fields_say_rad_and_newton_metres(choices: dict[str, Any]) -> None:
    kinds = choices["by_unit"]
    assert {name: one["unit"] for name, one in choices["sets"].items() if one["unit"] != "m"} == {SET: "rad"}
    assert kinds["rad"]["units"] == {"position": "rad", "speed": "rad/s", "force": "N m"}
    turning = [*kinds["rad"]["model"], *(one for law in kinds["rad"]["laws"].values() for one in law)]
    assert not {one.get("unit") for one in turning} & SLIDING_UNITS
    known = {one["name"]: one for one in turning}
    assert (known["gain"]["unit"], known["sigma_0"]["unit"]) == ("rad/V", "N m/rad")
    assert "incline" not in known
    assert known.keys() | {"incline"} == {
        one["name"]
        for one in [*kinds["m"]["model"], *(one for law in kinds["m"]["laws"].values() for one in law)]
    }
    for name, value in (choices["sets"][SET]["model"] | choices["sets"][SET]["friction"]["LuGre"]).items():
        if isinstance(value, float) and value > 0.0:  # within what its slider sweeps
            assert known[name]["low"] < value < known[name]["high"], name


def test_explore_moves_it_as_what_slides(client: httpx.Client, choices: dict[str, Any]) -> None:
    paths = ("/api/explore/motion", "/api/explore/steps")
    (straight, slow), (turned, curves) = (
        (
            answered(client, paths[0], state_of(choices, name)),
            answered(client, paths[1], state_of(choices, name)),
        )
        for name in ("kang2007", SET)
    )
    numbers = turned[0]["numbers"]
    assert [numbers[name]["unit"] for name in ("net_displacement", "mean_speed")] == ["rad", "rad/s"]
    for name, one in numbers.items():
        assert RADIUS * one["value"] == pytest.approx(straight[0]["numbers"][name]["value"], rel=1e-3)
    assert RADIUS * curves[1]["step"] == pytest.approx(slow[1]["step"], abs=2e-9)
    torque, force = (np.abs(one[1]["friction_force"]).max() for one in (turned, straight))
    assert torque == pytest.approx(RADIUS * force, rel=1e-2)
    code = client.post("/api/explore/python", json=state_of(choices, SET)).json()["code"]
    assert f'ss.load_actuator("{SET}")' in code
    assert "# rad per period" in code


def test_values_are_refused_in_its_units(client: httpx.Client, choices: dict[str, Any]) -> None:
    state = state_of(choices, SET)
    for value, said in (("5 N/m", "no N m/rad"), (-1.0, "must be > 0 N m/rad"), ("0.5 N m/mrad", "")):
        asked = state | {"friction": state["friction"] | {"sigma_0": value}}
        answer = client.post("/api/explore/python", json=asked)
        assert answer.status_code == (422 if said else 200)
        if said:
            assert said in answer.json()["error"]
            assert answer.json()["field"] == "friction.sigma_0"
    known = {one["name"]: one["unit"] for one in client.get("/api/design/fields").json()["rad"]}
    units = {"load": "N m", "voltage": "V", "spread": "N m", "capacitance": "F", "noise": "rad", "step": "V"}
    units |= {"knots": "", "update_rate": "Hz", "points": "", "current": "A", "slew_rate": "V/s"}
    assert known == units
    asked = model_of(choices, SET) | {"name": "spread", "value": "0.1 N"}
    assert "no N m" in client.post("/api/design/check", json=asked).json()["error"]


def test_design_maps_and_moves_it(client: httpx.Client, choices: dict[str, Any]) -> None:
    model = model_of(choices, SET)
    _, grid = answered(client, "/api/design/map", model | {"voltage": 80.0, "load": -0.05 * RADIUS})
    steps = grid["net_step"].reshape(grid["voltage"].size, -1)
    for i, k in ((32, 0), (20, 11)):
        drive = ss.Sawtooth(float(grid["voltage"][i]), float(grid["frequency"][k]))
        step = ss.steady_step(SLIDES.replace(external_force=-0.05), drive)
        assert RADIUS * steps[i, k] == pytest.approx(step, abs=3e-9)
    header, moved = answered(client, "/api/design/motion", model | {"drive": SAWTOOTH})
    step = ss.steady_step(SLIDES, ss.Sawtooth(65.0, 20.0))
    assert RADIUS * moved["end_effector_position"][-1] == pytest.approx(2.0 * step, abs=3e-9)
    assert RADIUS * header["speed"] == pytest.approx(20.0 * step, rel=1e-3)
    asked = model | {"drive": SAWTOOTH, "noise": "2 urad"}
    told = client.post("/api/design/tells", json=asked).json()["parameters"]
    assert {one["unit"] for one in told} == {"N m/rad", "N m s/rad", "N m", "rad/s", ""}


def test_a_prediction_says_angles(client: httpx.Client) -> None:
    asked = {"parameters": SET, "shape": "Sawtooth", "amplitude": "65 V", "frequency": "20 Hz", "periods": 3}
    numbers = client.post("/path/predict", json=asked).json()["numbers"]
    assert numbers["unit"] == "rad"
    step = ss.steady_step(SLIDES, ss.Sawtooth(65.0, 20.0))
    assert RADIUS * numbers["steady_step"] == pytest.approx(step, abs=2e-9)


def test_a_bench_of_angles_wants_what_turns(client: httpx.Client) -> None:
    asked = {"kind": "virtual", "bench": "bench.toml"}
    answer = client.post("/bench/rig", json=asked)
    assert answer.status_code == 400
    assert "gives rad: it is for an actuator with rotary = true" in answer.text


def walked(client: httpx.Client, path: str = "/bench/start", last: str = "done") -> dict[str, Any]:
    """Walk forward on the bench, to the end; what pages are told of the experiment."""
    with streaming(client) as stream:
        experiment = heard(stream, "experiment")
        heard(stream, "run")  # of before
        asked = {"runs": ["forward"]} if path == "/bench/start" else {}
        client.post(path, json=asked).raise_for_status()
        while heard(stream, "run", 300.0)["phase"] != last:
            pass
    return experiment


@pytest.mark.usefixtures("no_term_is_tried")
def test_from_the_bench_to_a_fit(client: httpx.Client, folder: Path, choices: dict[str, Any]) -> None:
    not_real_time = {"path": ["rig", "real_time"], "value": False}
    client.post("/bench/set", json=not_real_time).raise_for_status()
    walked(client)  # the panel's own, which slides
    client.post("/bench/load", json={"name": EXPERIMENT}).raise_for_status()
    experiment = walked(client)
    with streaming(client) as stream:
        statistics = heard(stream, "statistics")["values"]
    assert {statistics[name]["unit"] for name in ("position", "step", "mean step")} == {"rad"}
    assert experiment["rig"]["unit"] == "rad"
    units = {one["name"]: one["unit"] for one in [*experiment["channels"], *experiment["variables"]]}
    assert units["end_effector_position"] == "rad"
    assert units["friction.coulomb_force"] == "N m"
    assert not {*units.values()} & SLIDING_UNITS
    turned, straight = [one for one in client.get("/api/identify/recordings").json() if one["bench"]]
    assert (turned["unit"], straight["unit"]) == ("rad", "m")
    assert (turned["set"], straight["set"]) == (SET, "kang2007")
    assert turned["slew_rate"] == straight["slew_rate"] == pytest.approx(0.4 / 1.4e-6, rel=1e-3)
    ends = [
        float(ss.open_recording(folder / one["name"])["end_effector_position"][-1])
        for one in (turned, straight)
    ]
    assert RADIUS * ends[0] == pytest.approx(ends[1], rel=0.05)  # no run has the contact of another

    names = {"names": [turned["name"], straight["name"]]}
    differing = client.post("/history/differences", json=names).json()["differences"]
    known = {one["what"]: one["units"] for one in differing}
    assert known["contact: coulomb force"] == ["N m", "N"]
    answer = client.post("/history/overlay", json=names | {"channel": "end_effector_position"})
    assert "end_effector_position is in rad and in m: it cannot be compared" in answer.text

    said: dict[str, Any] = {}
    asked = model_of(choices, SET)
    asked["model"] = asked["model"] | {"stage_reaction": turned["stage_reaction"]}
    asked |= {"recordings": [turned["name"]], "free": ["coulomb_force", "offset", "delay"], "end": 1.0}
    request = FitRequest.model_validate(asked | {"slew_rate": turned["slew_rate"]})
    fit_recordings(request, Folder(folder), "fits/one", lambda kind, fields, arrays: said.update(fields))
    assert said["unit"] == "rad"
    found = said["fit"]["parameters"]
    assert (found["coulomb_force"]["unit"], found["offset"]["unit"]) == ("N m", "rad")
    assert found["coulomb_force"]["value"] == pytest.approx(TURNS.friction.coulomb_force, rel=0.05)


def test_the_way_home_and_the_end_stop_are_angles(client: httpx.Client) -> None:
    """After the walk of the test before, or of its own."""
    client.post("/bench/load", json={"name": EXPERIMENT}).raise_for_status()
    walked(client)
    walked(client, "/bench/home")
    stop = {"path": ["limits", "max_position"]}
    assert "no rad" in client.post("/bench/set", json=stop | {"value": "1 mm"}).json()["error"]
    client.post("/bench/set", json=stop | {"value": "1 mrad"}).raise_for_status()
    walked(client, last="failed")
    with streaming(client) as stream:
        said = " ".join(entry["text"] for entry in heard(stream, "log")["entries"])
    assert re.search(r"Home: home, to -?[\d.]+ [nµm]?rad, after", said)
    assert re.search(r"is at 1(\.\d+)? mrad from home, beyond the end stop at 1 mrad", said)
