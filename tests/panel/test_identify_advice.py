"""A fit that does not explain its walk: the panel has the request that would, and fits it."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np

import stickslip as ss
from stickslip.panel import create_app

from .serving import ME, client_of

KANG = ss.load_actuator("kang2007").replace(stage_reaction=False)


def fitted(client: httpx.Client, request: dict[str, Any]) -> dict[str, Any]:
    """How a fit ends."""
    answer = client.post("/api/identify/start", json=request)
    assert answer.status_code == 200, answer.text
    until = time.monotonic() + 300.0
    while (state := client.get("/api/identify/state").json())["phase"] == "running":
        assert time.monotonic() < until
        time.sleep(0.2)
    assert state["phase"] == "done", state.get("error")
    return state


def test_the_advice_is_a_request_that_explains_the_walk(tmp_path: Path) -> None:
    truth = KANG.replace(friction=KANG.friction._replace(sigma_2=9.0))
    walk = ss.simulate(truth, ss.Sawtooth("65 V", "20 Hz", periods=8), sample_rate="4 kHz")
    noise = 1e-8 * np.random.default_rng(1).standard_normal(walk.sizes["time"])
    walk["end_effector_position"] = walk["end_effector_position"] + noise
    walk["end_effector_position"].attrs["units"] = "m"
    ss.save_recording(walk[["drive_voltage", "end_effector_position"]], tmp_path / "walk.nc")
    with client_of(create_app(tmp_path), **ME) as client:
        law = client.get("/api/explore/choices").json()["sets"]["kang2007"]["friction"]["LuGre"]
        request = {"set": "kang2007", "law": "LuGre", "friction": law, "model": {"stage_reaction": False}}
        request |= {"recordings": ["walk.nc"], "free": ["sigma_0", "sigma_1", "coulomb_force"]}
        first = fitted(client, request)
        assert first["fit"]["advice"]["cause"] == "viscous friction"
        assert first["fit"]["advice"]["explains"]
        again = fitted(client, first["advised"])
        assert again["advised"] is None
        assert not again["fit"]["failures"]
        low, high = again["fit"]["parameters"]["sigma_2"]["interval"]
        assert 0.5 * low < 9.0 < 2.0 * high
        numbers = json.loads((tmp_path / first["report"]).with_name("results.json").read_text())
        assert "free: [sigma_0, sigma_1, coulomb_force, sigma_2]" in json.dumps(numbers)
