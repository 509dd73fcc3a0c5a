"""The rig on the bench: what can be chosen, what of the experiment fits, and what recordings say then."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

from stickslip import open_recording
from stickslip.rig.bench import _BENCHES

from .conftest import Panel
from .serving import heard, streaming
from .test_bench_routes import change, ran

from twins.serving import served, twin_of  # isort: skip


@pytest.mark.browser
def test_a_rig_is_chosen_on_the_page(panel: Panel, page: Page) -> None:
    page.goto(panel.url)
    rig = page.locator("#rig")
    expect(rig).to_have_text("virtual rig kang2007-bench…")
    rig.click()
    facts = page.locator("dialog .facts")
    expect(facts).to_contain_text("-10 V to 150 V in steps of 78.02 mV, at 20 kHz")
    expect(facts).to_contain_text("none: one clock")
    page.get_by_text("piezosystem jena NV200").click()
    page.get_by_label("Options of nv200").fill("host: 127.0.0.1, port: 1")
    page.get_by_role("button", name="Use nv200").click()
    expect(page.locator("dialog .fault")).to_contain_text("cannot be reached")
    page.get_by_role("button", name="virtual rig, kang2007-hysteresis-bench").click()
    expect(page.locator("dialog")).to_have_count(0)
    expect(rig).to_have_text("virtual rig kang2007-hysteresis-bench…")
    page.get_by_role("button", name="Undo").click()
    expect(rig).to_have_text("virtual rig kang2007-bench…")


@pytest.fixture(scope="module")
def client(client: httpx.Client, folder: Path) -> Iterator[httpx.Client]:
    (folder / "mine.toml").write_text((_BENCHES / "kang2007-bench.toml").read_text())
    (folder / "other.toml").write_text("title = 'no bench'")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STICKSLIP_RIGS", str(folder / ".rigs"))
        yield client


def told(client: httpx.Client) -> dict:
    """What pages are told of the experiment."""
    with streaming(client) as stream:
        return heard(stream, "experiment")


def chosen(client: httpx.Client, **rig: str) -> httpx.Response:
    return client.post("/bench/rig", json=rig)


def test_benches_and_back_ends_are_offered(client: httpx.Client) -> None:
    offered = client.get("/bench/rigs").json()["rigs"]
    benches = [one["bench"] for one in offered if one["kind"] == "virtual"]
    assert benches == ["kang2007-bench", "kang2007-hysteresis-bench", "mine.toml"]
    nv200 = next(one for one in offered if one["kind"] == "nv200")
    assert nv200["options"].startswith("host: , port: 23, interval: ")
    assert "not run on hardware" in nv200["verified"]


def test_another_bench_keeps_the_experiment(client: httpx.Client) -> None:
    before = told(client)
    assert before["rig"]["name"] == "virtual rig kang2007-bench"
    assert before["rig"]["limits"]["max_voltage"] == 100.0
    assert before["rig"]["streams"]
    said = chosen(client, kind="virtual", bench="mine.toml")
    assert said.json() == {"left_out": []}
    after = told(client)
    assert after["content"]["rig"]["bench"] == "mine.toml"
    assert {**after["content"], "rig": 0} == {**before["content"], "rig": 0}
    assert client.post("/bench/undo", json={}).json()["done"]
    assert told(client)["content"] == before["content"]


@pytest.mark.parametrize(
    ("rig", "why"),
    [
        ({"kind": "virtual", "bench": "other.toml"}, "other.toml"),
        ({"kind": "virtual", "bench": "../mine.toml"}, "folder"),
        ({"kind": "nv200", "options": "host: 127.0.0.1, port: 1"}, "cannot be reached"),
        ({"kind": "nv200", "options": "host: }"}, "options = "),
        ({"kind": "nv200", "options": "nothing: 1"}, "nothing"),
        ({"kind": "mine.py:Rig"}, "mine.py"),
        ({"kind": "unheard"}, "unheard"),
    ],
)
def test_what_cannot_be_used_changes_nothing(client: httpx.Client, rig: dict[str, str], why: str) -> None:
    before = told(client)["content"]
    said = chosen(client, **rig)
    assert 400 <= said.status_code < 500, said.text
    assert why in said.text
    assert told(client)["content"] == before


def test_a_controller_is_chosen_and_recorded_from(client: httpx.Client, folder: Path) -> None:
    """What the NV200 cannot do is left out, and told; Undo brings it back."""
    with served(twin_of("nv200", axes=1)) as port:
        change(client, ["runs", 1, "waveform", 0, "fields", "periods"], 1).raise_for_status()
        change(client, ["runs", 1, "capture", "length"], "0.4 s").raise_for_status()
        change(client, ["variables", "frequency"], "10 Hz").raise_for_status()
        options = f"host: 127.0.0.1, port: {port}, interval: 250 us, timeout: 20"
        said = chosen(client, kind="nv200", options=options)
        assert said.status_code == 200, said.text
        left_out = " ".join(said.json()["left_out"])
        assert "channel piezo_elongation" in left_out
        assert "run walk: " in left_out
        now = told(client)
        assert now["rig"]["name"].startswith("NV200 STICKSLIP")
        assert not now["rig"]["streams"]
        assert [one["name"] for one in now["content"]["runs"]] == ["forward"]
        assert {one["name"] for one in now["channels"]} == {"drive_voltage", "end_effector_position"}
        client.post("/interlock/arm", json={"why": "a test"}).raise_for_status()
        ran(client, "/bench/start", {"runs": ["forward"]})
        recording = open_recording(folder / client.get("/recordings").json()[0]["name"])
        device = json.loads(recording.attrs["device"])
        assert device["device"] == "NV200/D_NET"
        assert device["interval"] == 250e-6
        client.post("/bench/undo", json={}).raise_for_status()
        assert len(told(client)["content"]["runs"]) == 3
