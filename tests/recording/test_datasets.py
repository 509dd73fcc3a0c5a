"""Where published data come from: a folder, or the makers' repository by checksum."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from datasets import DATASETS as FOLDER
from stickslip.recording import RecordingError, datasets
from stickslip.recording.datasets import DATASETS, dataset_path, fetch

FILES = [(name, path) for name, dataset in DATASETS.items() for path in dataset.files]


def test_checksums_are_those_of_the_data() -> None:
    for name, path in FILES:
        found = dataset_path(name, Path(path).name)
        assert found.samefile(FOLDER / name / Path(path).name)
        assert hashlib.sha256(found.read_bytes()).hexdigest() == DATASETS[name].files[path]


def test_the_list_is_complete() -> None:
    listed = {line.split()[1].removeprefix("./") for line in (FOLDER / "SHA256SUMS").read_text().splitlines()}
    data = {path for path in listed if not path.endswith("SOURCE.txt") and "LICENSE" not in path}
    assert data == {f"{name}/{Path(path).name}" for name, path in FILES}


def test_credit_is_given() -> None:
    for name, dataset in DATASETS.items():
        source = (FOLDER / name / "SOURCE.txt").read_text()
        commit = dataset.url.rsplit("/", 1)[1]
        assert len(commit) == 40
        for word in (dataset.licence.split()[0], commit, "/".join(dataset.url.split("/")[3:5])):
            assert word in source


def test_a_folder_of_ones_own_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "yan9a-dbo" / "Model_Vi_Do.dat"
    own.parent.mkdir()
    own.touch()
    monkeypatch.setenv("STICKSLIP_DATASETS", str(tmp_path))
    assert dataset_path("yan9a-dbo", "Model_Vi_Do.dat") == own
    assert dataset_path("yan9a-dbo", "Test_Vi_Do_Di.dat").parent.samefile(FOLDER / "yan9a-dbo")


def test_the_folder_beside_a_checkout_may_be_a_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    link = tmp_path / "shared"
    link.symlink_to(FOLDER.parent, target_is_directory=True)
    monkeypatch.setattr(datasets, "_BESIDE_CHECKOUT", link / "datasets")
    for name, path in FILES:
        assert dataset_path(name, Path(path).name).samefile(FOLDER / name / Path(path).name)


def test_unknown_names() -> None:
    with pytest.raises(RecordingError, match=r"no data set 'yan'; there are .*yan9a-dbo"):
        dataset_path("yan", "Model_Vi_Do.dat")
    with pytest.raises(RecordingError, match=r"yan9a-dbo has no file 'a\.dat'; it has Model_Vi_Do\.dat"):
        dataset_path("yan9a-dbo", "a.dat")


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """The address of a folder with the file published/a.dat, served as a repository is."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: object) -> None:
            pass

    (tmp_path / "published").mkdir()
    (tmp_path / "published" / "a.dat").write_text("1 2\n3 4\n")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(tmp_path))) as served:
        threading.Thread(target=served.serve_forever, args=(0.05,), daemon=True).start()
        yield f"http://127.0.0.1:{served.server_port}/published"
        served.shutdown()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache of its own, no folder of data, and no proxy on the way to this computer."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    monkeypatch.delenv("STICKSLIP_DATASETS", raising=False)
    monkeypatch.setattr(datasets, "_BESIDE_CHECKOUT", tmp_path / "nowhere")
    return tmp_path / "cache"


DIGEST = hashlib.sha256(b"1 2\n3 4\n").hexdigest()


def test_fetching(server: str, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = datasets.Dataset(server.removesuffix("/published"), "", "", {"published/a.dat": DIGEST})
    monkeypatch.setitem(DATASETS, "made", made)
    path = dataset_path("made", "a.dat")
    assert path == cache / "stickslip" / "made" / "a.dat"
    assert path.read_text() == "1 2\n3 4\n"
    assert fetch("http://127.0.0.1:1/published/a.dat", DIGEST, "made") == path, "the second time it is here"


def test_what_cannot_be_fetched(server: str, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RecordingError, match=r"cannot be fetched from .*hash"):
        fetch(f"{server}/a.dat", "0" * 64, "made")
    assert not list(cache.rglob("*.dat")), "nothing unchecked is kept"
    with pytest.raises(RecordingError, match=r"cannot be fetched from .*404"):
        fetch(f"{server}/b.dat", DIGEST, "made")
    unreachable = datasets.Dataset("http://127.0.0.1:1", "", "", {"published/a.dat": DIGEST})
    monkeypatch.setitem(DATASETS, "made", unreachable)
    why = r"and it cannot be fetched from http\S*a\.dat: \[Errno 111\] Connection refused; STICKSLIP"
    with pytest.raises(RecordingError, match=rf"a\.dat is not in this installation, {why}"):
        dataset_path("made", "a.dat")
    monkeypatch.setenv("STICKSLIP_DATASETS", str(cache / "nowhere"))
    with pytest.raises(RecordingError, match=rf"a\.dat is not in \S*nowhere/made, {why}"):
        dataset_path("made", "a.dat")
