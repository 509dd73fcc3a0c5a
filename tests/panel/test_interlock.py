"""The interlock in the panel: armed on purpose, withdrawn by anybody, faults that wait to be acknowledged."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect

from stickslip.panel import create_app

from .conftest import CLIENT, Panel, connected
from .serving import ME, client_of, heard, streaming
from .test_bench_routes import change, ran
from .test_rigs import chosen

from twins.serving import served, twin_of  # isort: skip


@pytest.fixture(scope="module")
def controller(client: httpx.Client, folder: Path) -> Iterator[httpx.Client]:
    """The client of a panel with a controller on its bench, which has an output to enable."""
    with pytest.MonkeyPatch.context() as patch, served(twin_of("nv200", axes=1)) as port:
        patch.setenv("STICKSLIP_RIGS", str(folder / ".rigs"))
        change(client, ["runs", 1, "waveform", 0, "fields", "periods"], 1).raise_for_status()
        change(client, ["runs", 1, "capture", "length"], "0.4 s").raise_for_status()
        change(client, ["variables", "frequency"], "10 Hz").raise_for_status()
        options = f"host: 127.0.0.1, port: {port}, interval: 250 us, timeout: 20"
        chosen(client, kind="nv200", options=options).raise_for_status()
        with streaming(client) as page:  # who leaves for some seconds has disarmed it
            threading.Thread(target=list, args=(page,), daemon=True).start()
            yield client
        client.post("/bench/undo", json={}).raise_for_status()


def act(client: httpx.Client, what: str, **body: object) -> httpx.Response:
    return client.post(f"/interlock/{what}", json={"why": "a test", **body})


def started(client: httpx.Client) -> httpx.Response:
    return client.post("/bench/start", json={"runs": ["forward"]})


def test_a_run_of_a_controller_waits_until_it_is_armed(controller: httpx.Client) -> None:
    assert "the output is not armed" in started(controller).text
    assert "say why" in act(controller, "arm", why=" ").text
    said = act(controller, "arm").json()
    assert said["state"] == "armed"
    assert said["armed_by"].startswith("somebody (page ")
    ran(controller, "/bench/start", {"runs": ["forward"]})
    ran(controller, "/bench/start", {"runs": ["forward"]})
    with streaming(controller) as stream:
        assert heard(stream, "interlock")["state"] == "armed"
        stream.send(json.dumps({"kind": "emergency_stop"}))
        while heard(stream, "interlock")["state"] != "disarmed":
            pass
    assert "the output is not armed" in started(controller).text


def test_whoever_watches_may_withdraw_the_permit_but_not_give_it(controller: httpx.Client) -> None:
    act(controller, "arm").raise_for_status()
    other = {"X-Client": "a watcher"}
    withdrawn = {"name": "operators", "given": False, "why": "I am in the beam"}
    said = controller.post("/interlock/permit", json=withdrawn, headers=other).json()
    assert said["state"] == "withheld"
    assert "I am in the beam" in started(controller).text
    assert "I am in the beam" in act(controller, "arm").text
    given = controller.post("/interlock/permit", json=withdrawn | {"given": True}, headers=other)
    assert "another page controls the rig" in given.text
    assert act(controller, "permit", name="operators", given=True).json()["state"] == "disarmed"
    assert "is no permit of this rig" in act(controller, "permit", name="moon", given=True).text


def test_the_log_says_who_did_what_and_why(controller: httpx.Client, folder: Path) -> None:
    act(controller, "arm", why="for the log").raise_for_status()
    change(controller, ["limits", "max_voltage"], "90 V").raise_for_status()
    rows = controller.get("/history/log", params={"search": "for the log"}).json()["rows"]
    assert {(one["of"], one["what"]) for one in rows} == {("panel", "armed"), ("rig", "armed: the output")}
    assert all(one["who"].startswith("somebody (page ") and one["why"] == "for the log" for one in rows)
    (changed,) = controller.get("/history/log", params={"search": "limits changed 90"}).json()["rows"]
    assert changed["what"] == "limits changed: max_voltage 100 V -> 90 V"
    assert changed["where"] == "127.0.0.1"
    written = (folder / "log.jsonl").read_text(encoding="utf-8").splitlines()
    assert json.loads(written[-1])["what"] == changed["what"]


def test_pages_are_told_the_log_of_panels_before(folder: Path, client: httpx.Client) -> None:
    with client_of(create_app(folder), **ME) as again, streaming(again) as stream:
        texts = [one["text"] for one in heard(stream, "log")["entries"]]
    assert "limits changed: max_voltage 100 V -> 90 V" in texts


@pytest.mark.browser
def test_the_log_is_searched_on_the_history_page(panel: Panel, page: Page) -> None:
    page.goto(panel.url)
    with connected(panel, {"X-Client": CLIENT}) as asking:
        change(asking, ["limits", "max_position"], "40 um").raise_for_status()
        change(asking, ["limits", "max_position"], "50 um").raise_for_status()
    page.goto(f"{panel.url}#history")
    page.get_by_role("button", name="Log", exact=True).click()
    rows = page.locator(".history-log tbody tr")
    expect(rows.first).to_contain_text("max_position 40 µm -> 50 µm")
    page.get_by_label("Search the log").fill("limits 500")
    expect(rows).to_have_count(1)
    expect(rows.first).to_contain_text("max_position 500 µm -> 40 µm")


@pytest.mark.browser
def test_a_fault_is_shown_until_it_is_acknowledged_with_a_reason(panel: Panel, page: Page) -> None:
    page.goto(panel.url)
    bar, button = page.locator("#latched"), page.locator("#interlock")
    expect(button).to_have_text("Simulated")
    expect(bar).to_be_hidden()
    with connected(panel, {"X-Client": CLIENT}) as asking:
        change(asking, ["limits", "max_position"], "5 um").raise_for_status()
    page.get_by_role("button", name="Start").click()
    expect(bar).to_contain_text("beyond the end stop at 5 µm")
    expect(button).to_have_text("Fault")
    page.get_by_role("button", name="Start").click()
    expect(page.locator("#notices")).to_contain_text("not acknowledged")
    bar.get_by_role("button").click()
    dialog = page.get_by_role("dialog", name="Interlock")
    dialog.get_by_role("button", name="Acknowledge the fault").click()
    expect(dialog.get_by_role("alert")).to_contain_text("say why")
    dialog.get_by_label("Why").fill("the end stop was meant")
    dialog.get_by_role("button", name="Acknowledge the fault").click()
    expect(page.locator("#interlock-state")).to_have_text("Simulated")
    dialog.get_by_label("Why").fill("lunch")
    dialog.get_by_role("button", name="Withdraw").click()
    expect(page.locator("#interlock-state")).to_have_text("Permit missing")
    dialog.get_by_label("Why").fill("back again")
    dialog.get_by_role("button", name="Give").click()
    expect(page.locator("#interlock-state")).to_have_text("Simulated")
    dialog.get_by_role("button", name="Close").click()
    expect(bar).to_be_hidden()
