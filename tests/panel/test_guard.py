"""Who may talk to the panel, and what they may reach."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import InvalidStatus

from stickslip.panel import create_app
from stickslip.panel.folder import Folder, FolderError
from stickslip.panel.guard import MOST_WRONG

from .serving import ME, client_of, heard, streaming

TOKEN = "a-token-of-some-length"


@pytest.fixture(scope="module")
def folder(folder: Path) -> Path:
    made = folder
    (made.parent / "secret.nc").write_bytes(b"secret")
    (made.parent / "secret.yaml").write_text("title: secret")
    (made / "link.nc").symlink_to(made.parent / "secret.nc")
    (made / "link.yaml").symlink_to(made.parent / "secret.yaml")
    (made / "linked").symlink_to(made.parent)
    (made / "note.nc").write_bytes(b"no recording")
    return made


@pytest.fixture(scope="module")
def guarded(folder: Path) -> Iterator[httpx.Client]:
    with client_of(create_app(folder, token=TOKEN, any_address=True)) as made:
        yield made


def test_the_page_and_its_headers(client: httpx.Client) -> None:
    answer = client.get("/")
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "frame-ancestors 'none'" in policy


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "[::2]:80", ""]
)
def test_another_host_is_refused(client: httpx.Client, host: str) -> None:
    """A name of somebody else that points here: DNS rebinding."""
    assert client.get("/", headers={"Host": host}).status_code == 421


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:9", "[::1]:8080", "LOCALHOST"])
def test_names_of_this_machine_are_known(client: httpx.Client, host: str) -> None:
    assert client.get("/", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:8081", "file://"])
def test_another_origin_is_refused(client: httpx.Client, origin: str) -> None:
    assert client.post("/bench/stop", headers={"Origin": origin}).status_code == 403
    with pytest.raises(InvalidStatus) as refused, streaming(client, {"Origin": origin}):
        pass
    assert refused.value.response.status_code == 403


def test_the_own_origin_is_let_in(client: httpx.Client) -> None:
    own = {"Origin": str(client.base_url).rstrip("/"), **ME}
    assert client.post("/quantity", json={"text": "0.065 kV", "unit": "V"}, headers=own).json() == {
        "value": 65.0
    }
    with streaming(client, own) as stream:
        assert heard(stream, "hello")["boot"]


@pytest.mark.parametrize("path", ["/", "/bench/experiments", "/recordings", "/static/app.js"])
def test_off_loopback_nothing_without_the_token(guarded: httpx.Client, path: str) -> None:
    assert guarded.get(path).status_code == 401
    assert guarded.get(path, headers={"Authorization": "Bearer wrong"}).status_code == 401
    assert guarded.get(path, headers={"Authorization": f"Bearer {TOKEN}"}).status_code == 200


def test_wrong_tokens_do_not_keep_the_right_one_from_the_stop(guarded: httpx.Client) -> None:
    """Behind a tunnel everybody has one address."""
    wrong, right = {"Authorization": "Bearer wrong"}, {"Authorization": f"Bearer {TOKEN}"}
    with ThreadPoolExecutor(2 * MOST_WRONG) as pool:
        asked = [pool.submit(guarded.get, "/", headers=wrong) for _ in range(2 * MOST_WRONG)]
        while not any(one.done() for one in asked):  # the first that is refused without a wait
            time.sleep(0.01)
        assert guarded.post("/bench/stop", headers=right).status_code == 200
        assert not all(one.done() for one in asked), "the wrong ones still wait"
        answers = sorted(one.result().status_code for one in asked)
    assert answers == [401] * MOST_WRONG + [429] * MOST_WRONG


def test_the_token_in_the_address_becomes_a_cookie(guarded: httpx.Client) -> None:
    assert guarded.get("/?token=wrong").status_code == 401
    assert guarded.get(f"/recordings?token={TOKEN}").status_code == 401, "a token stands in no other address"
    answer = guarded.get(f"/?token={TOKEN}")
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert {"HttpOnly", "SameSite=Strict"} <= set(answer.headers["set-cookie"].split("; "))
    cookie = answer.headers["set-cookie"].split(";")[0]
    guarded.cookies.clear()
    assert guarded.get("/", headers={"Cookie": cookie}).status_code == 200
    with pytest.raises(InvalidStatus), streaming(guarded):
        pass
    with streaming(guarded, {"Cookie": cookie}) as stream:
        assert heard(stream, "hello")["boot"]


def test_off_loopback_an_address_in_numbers_is_known_but_no_foreign_name(guarded: httpx.Client) -> None:
    shown = {"Authorization": f"Bearer {TOKEN}"}
    assert guarded.get("/", headers={**shown, "Host": "10.0.0.3:8080"}).status_code == 200
    assert guarded.get("/", headers={**shown, "Host": "evil.example"}).status_code == 421


NAMES = [
    "../secret.nc", "/etc/passwd", "linked/secret.nc", "link.nc", "a/../../secret.nc", "..\\secret.nc",
    "C:secret.nc", ".hidden.nc", "a//b.nc", "", ".", "a\0.nc", "a\nb.nc", "x" * 500,
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_nothing_outside_the_folder_is_reached(client: httpx.Client, folder: Path, name: str) -> None:
    for path, body in [
        ("/recordings/show", {"name": name}),
        ("/recordings/rename", {"name": name, "to": "mine.nc"}),
        ("/recordings/rename", {"name": "note.nc", "to": name}),
        ("/bench/load", {"name": name}),
        ("/bench/save", {"name": name.replace(".nc", ".yaml")}),
    ]:
        answer = client.post(path, json=body, headers=ME)
        assert 400 <= answer.status_code < 500, (path, answer.text)
        assert str(folder.parent) not in answer.text
        assert "root:" not in answer.text
    assert client.get("/recordings/export", params={"name": name}).status_code == 400
    assert (folder / "note.nc").read_bytes() == b"no recording"
    assert sorted(os.listdir(folder.parent)) == ["folder", "secret.nc", "secret.yaml"]


@pytest.mark.parametrize("path", ["..%2fserver.py", "%2e%2e/server.py", "....//server.py", "%2fetc%2fpasswd"])
def test_only_the_page_s_own_files_are_served(client: httpx.Client, path: str) -> None:
    assert client.get(f"/static/{path}").status_code == 404


def test_links_that_lead_out_are_not_listed(client: httpx.Client) -> None:
    assert [one["name"] for one in client.get("/recordings").json()] == ["note.nc"]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["channels", "piezo_elongation", "calibration"], ["../secret.json"]),
        (["rig", "bench"], "/etc/bench.toml"),
        (["actuator", "set"], "linked/own.toml"),
        (["runs", 0, "waveform"], [{"file": "../secret.nc"}]),
    ],
)
def test_an_experiment_may_not_name_files_outside(client: httpx.Client, path: list, value: object) -> None:
    answer = client.post("/bench/set", json={"path": path, "value": value}, headers=ME)
    assert answer.status_code == 400
    assert "panel's folder" in answer.json()["error"]


def test_errors_do_not_tell_paths(client: httpx.Client, folder: Path) -> None:
    answer = client.post("/recordings/show", json={"name": "note.nc"})
    assert answer.status_code == 400
    assert "note.nc" in answer.json()["error"]
    assert str(folder) not in answer.text
    told = Folder(folder).told
    assert told("cannot read /srv/me/x/set.toml: 3 V/s, N/m") == "cannot read set.toml: 3 V/s, N/m"
    assert told(f"{folder}/a/b.nc: gone") == "a/b.nc: gone"


def test_requests_are_of_limited_size(folder: Path) -> None:
    with client_of(create_app(folder, largest_body=1000)) as client:
        assert client.post("/quantity", json={"text": "1" * 2000}).status_code == 413
        chunks = (b"x" * 400 for _ in range(5))  # no length is said before
        assert client.post("/quantity", content=chunks).status_code == 413
        assert client.post("/quantity", json={"text": "1"}).status_code == 200


@pytest.mark.parametrize("body", [b"{", b"[]", b'{"text": 5}', b'{"text": "1", "more": 1}', b"\xff"])
def test_malformed_requests_are_one_line(client: httpx.Client, body: bytes) -> None:
    answer = client.post("/quantity", content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code == 400
    assert set(answer.json()) == {"error"}


def test_malformed_messages_on_the_stream_are_ignored(client: httpx.Client) -> None:
    with streaming(client) as stream:
        texts = ("[1]", '"x"', "[" * 5000, '{"kind": ["a"]}', "", '{"kind": "emergency_stop"}')
        for text in texts:
            stream.send(text)
        assert "0 V" in heard(stream, "notice")["text"]


def test_a_folder_names_only_what_is_in_it(tmp_path: Path) -> None:
    folder = Folder(tmp_path)
    assert folder.path("a/b c.nc") == tmp_path / "a" / "b c.nc"
    with pytest.raises(FolderError, match="no name of a file"):
        folder.path("../x")
