"""Roles: who watches may stop and withdraw, and neither moves nor writes; limits need a maintainer."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from playwright.sync_api import Browser, expect

from stickslip.panel import create_app
from stickslip.panel.roles import least_role

from .conftest import Panel, opening
from .serving import client_of, heard, streaming

MAINTAIN, OPERATE, WATCH = "a-token-to-maintain", "a-token-to-operate", "a-token-to-watch"
TOKENS = {OPERATE: "operate", WATCH: "watch"}


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    return create_app(tmp_path_factory.mktemp("roles"), token=MAINTAIN, tokens=TOKENS)


@pytest.fixture(scope="module")
def client(app: FastAPI) -> Iterator[httpx.Client]:
    with client_of(app) as made:
        yield made


def by(token: str, page: str = "one") -> dict[str, str]:
    return {"Authorization": f"Bearer {token}", "X-Client": page}


def set_limit(client: httpx.Client, token: str, value: str = "80 V") -> httpx.Response:
    body = {"path": ["limits", "max_voltage"], "value": value}
    return client.post("/bench/set", json=body, headers=by(token))


def test_a_watcher_writes_and_moves_nothing(app: FastAPI, client: httpx.Client) -> None:
    """Each request of the application but those that are known to write nothing is refused, new ones too."""
    paths = app.openapi()["paths"]
    asked = [(path, method.upper()) for path in paths for method in paths[path]]
    refused = [path for path, method in asked if least_role(method, path) != "watch"]
    writes = ("/bench/start", "/history/annotate", "/history/upload", "/studies/begin", "/bench/note")
    assert {*writes} <= {*refused}
    for path in refused:
        answer = client.post(path, json={}, headers=by(WATCH))
        assert answer.status_code == 403, path
        assert re.search("needs the role (operate|maintain), and your token is one to watch", answer.text)
    assert client.get("/recordings", headers=by(WATCH)).status_code == 200
    assert client.get("/history", headers=by(WATCH)).status_code == 200


def test_a_watcher_stops_and_withdraws_but_gives_nothing(client: httpx.Client) -> None:
    assert client.post("/bench/stop", headers=by(WATCH)).status_code == 200
    permit = {"name": "operators", "why": "a test"}
    withdrawn = client.post("/interlock/permit", json=permit | {"given": False}, headers=by(WATCH))
    assert withdrawn.json()["permits"]["operators"]["who"].startswith("somebody (page ")
    assert "may watch" in withdrawn.json()["permits"]["operators"]["who"]
    given = client.post("/interlock/permit", json=permit | {"given": True}, headers=by(WATCH))
    assert "this needs the role operate" in given.text
    again = client.post("/interlock/permit", json=permit | {"given": True}, headers=by(OPERATE))
    assert again.json()["state"] == "disarmed"


def test_a_watcher_gets_no_control_on_the_stream(client: httpx.Client) -> None:
    with streaming(client, by(WATCH), client="watching") as stream:
        assert heard(stream, "hello")["role"] == "watch"
        while heard(stream, "control")["holder"]:  # the page of the test before is gone
            pass
        stream.send(json.dumps({"kind": "ask_control"}))
        stream.send(json.dumps({"kind": "emergency_stop"}))
        assert "Nothing was running" in heard(stream, "notice")["text"]
        with streaming(client, by(OPERATE), client="operating") as other:
            you = heard(other, "hello")["you"]
            other.send(json.dumps({"kind": "ask_control"}))
            while (holder := heard(stream, "control")["holder"]) == "":
                pass
            assert holder == you
            other.send(json.dumps({"kind": "hand_over"}))
            while heard(stream, "control")["holder"]:
                pass


def test_limits_need_a_maintainer(client: httpx.Client) -> None:
    variable = {"path": ["variables", "frequency"], "value": "7 Hz"}
    assert client.post("/bench/set", json=variable, headers=by(OPERATE)).status_code == 200
    assert "this needs the role maintain" in set_limit(client, OPERATE).text
    beat = {"path": ["limits", "heartbeat"], "value": "200 ms"}
    assert client.post("/bench/set", json=beat, headers=by(OPERATE)).status_code == 200
    assert client.post("/bench/undo", json={}, headers=by(OPERATE)).status_code == 200
    assert set_limit(client, MAINTAIN).status_code == 200
    undone = client.post("/bench/undo", json={}, headers=by(OPERATE))
    assert "this needs the role maintain" in undone.text
    rows = client.get("/history/log", params={"search": "limits changed"}, headers=by(WATCH)).json()["rows"]
    assert [one["what"] for one in rows] == [
        "limits changed: max_voltage 100 V -> 80 V",
        "limits changed: heartbeat 200 ms -> none",
        "limits changed: heartbeat none -> 200 ms",
    ]
    assert client.post("/bench/undo", json={}, headers=by(MAINTAIN)).json()["done"]
    rig = {"kind": "virtual", "bench": "kang2007-hysteresis-bench"}
    assert client.post("/bench/rig", json=rig, headers=by(OPERATE)).status_code == 403


@pytest.mark.browser
def test_a_page_of_a_watcher_says_so(browser: Browser, tmp_path: Path) -> None:
    served = Panel(tmp_path, "--role", "watch")
    try:
        assert "?token=" in served.url, "this machine needs a token too"
        assert served.process.stdout is not None
        line = served.process.stdout.readline()
        assert line.startswith("Panel, to watch: ")
        with opening(browser) as page:
            page.goto(line.split(": ")[1].strip())
            expect(page.locator("#control")).to_have_text("Watching")
            expect(page.locator("#start")).to_be_disabled()
            expect(page.locator("#stop")).to_be_enabled()
    finally:
        served.end()
