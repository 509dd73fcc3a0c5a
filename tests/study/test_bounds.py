"""Stores that claim or contain far more than a study does: one sentence, in bounded time and memory."""

from __future__ import annotations

import json
import os
import shutil
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import google_crc32c
import numpy as np
import pytest

import stickslip as ss
import study_functions
from stickslip.jobs.analysis.study import study_of_file
from stickslip.quantities.units import QuantityError
from stickslip.study import StudyError, export_study, open_study, study_state
from stickslip.study.chunks import ChunkError, chunk_bytes, comment_of, texts_of, with_comment
from stickslip.study.creating import create
from stickslip.study.layout import MOST_CHUNK_BYTES, TEXT
from stickslip.study.picture import study_picture
from stickslip.study.sealing import checks_of, sealed, task_seal
from stickslip.study.store import Store

STUDY = """\
kind: study
measure: {kind: own, function: study_functions.py:squares}
task: 3
grid: {x: {start: 0, stop: 3, points: 4}, y: {start: 4, stop: 6, points: 3}}
"""
LARGE = 2**42  # bytes of a file that takes no room on the disk


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a study of 4 tasks that is done."""
    folder = tmp_path_factory.mktemp("bounds")
    (folder / "study.yaml").write_text(STUDY)
    shutil.copy(study_functions.__file__, folder)
    ss.run_study(study_of_file(folder / "study.yaml"), folder / "s.zarr", workers=1)
    return folder / "s.zarr"


@pytest.fixture
def store(whole: Path, tmp_path: Path) -> Path:
    shutil.copy(whole.parent / "study.yaml", tmp_path)
    shutil.copy(whole.parent / "study_functions.py", tmp_path)
    return Path(shutil.copytree(whole, tmp_path / "s.zarr"))


def forge(store: Path, change: Callable[[Any], object]) -> None:
    """Change the layout of a store, and seal it again."""
    group = json.loads((store / "zarr.json").read_text())
    made = json.loads(group["attributes"]["study"])
    change(made["layout"])
    group["attributes"]["study"] = json.dumps(made)
    (store / "zarr.json").write_text(sealed(group))


@pytest.mark.parametrize(
    "name", ["zarr.json", "x/zarr.json", "x/c/0", "value/c/0/0", "status/c/0/0", "reason/c/0/0"]
)
def test_a_file_of_any_size_is_refused_unread(store: Path, name: str) -> None:
    os.truncate(store / name, LARGE)
    with pytest.raises(StudyError, match=r"has 4,398,046,511,104 bytes; up to [0-9,]+ are possible"):
        export_study(store, store.parent / "a.csv")


def test_the_state_of_ten_million_tasks_takes_no_look_for_each(store: Path, monkeypatch: Any) -> None:
    """Only files that are there are looked at, also behind names that are no numbers of tasks."""
    forge(store, lambda made: made.update(shape=[10_000_000, 1], task=[1, 1]))
    for name in ("01", "-1", "x", "10000000", "9" * 200):
        (store / "status" / "c" / name).mkdir()
    looked: list[Path] = []
    exists = Path.exists
    monkeypatch.setattr(Path, "exists", lambda path: looked.append(path) or exists(path))
    found = study_state(store)
    assert (found.tasks, found.done) == (10_000_000, 4)
    assert len(looked) < 100


LAYOUTS: dict[str, tuple[Callable[[Any], object], str]] = {
    "chunk": (
        lambda made: made["variables"][0].update(inner=[["time", 10**12]]),
        "a task would have 24,000,000 MB",
    ),
    "dimensions": (
        lambda made: made.update(dims=[f"d{i}" for i in range(33)], shape=[1] * 33, task=[1] * 33),
        "1 to 32 dimensions",
    ),
    "status over less": (lambda made: made["variables"][-1].update(dims=["x"]), "no reasons and status"),
    "statuses": (
        lambda made: made["variables"][-1]["about"].update(flag_values=[[0], 1]),
        "have no meanings",
    ),
    "meanings": (lambda made: made["variables"][-1]["about"].update(flag_meanings=3), "is damaged"),
}


@pytest.mark.parametrize("case", LAYOUTS)
def test_a_forged_layout_is_said(store: Path, case: str) -> None:
    change, words = LAYOUTS[case]
    forge(store, change)
    with pytest.raises(StudyError, match=words):
        study_state(store)


def forge_texts(store: Path, raw: bytes) -> None:
    """Put other texts into the first task, with a seal that is right."""
    there, file = Store(store), store / "reason" / "c" / "0" / "0"
    packer = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
    packed = packer.compress(raw) + packer.flush()
    checks = checks_of(comment_of(file.read_bytes()[:-4])[0], there._key, 0)
    checks["reason"] = google_crc32c.value(packed)
    data = with_comment(packed, task_seal(there._key, 0, checks))
    file.write_bytes(data + google_crc32c.value(data).to_bytes(4, "little"))


def lengths(*found: int) -> bytes:
    return b"".join(one.to_bytes(4, "little") for one in found)


TEXTS = {  # a task has 3 texts
    "128 MB": (bytes(MOST_CHUNK_BYTES + 1), "unpacks to more than 128,000,000 bytes"),
    "many": (lengths(30_000_000) + bytes(120_000_000), "has not 3 texts"),
    "few": (lengths(2, 0, 0), "has not 3 texts"),
    "short": (lengths(3, 0, 0, 9) + b"abc", "texts of wrong lengths"),
    "long": (lengths(3, 0, 0, 1) + b"abc", "texts of wrong lengths"),
    "far": (lengths(3, 2**32 - 1, 0, 0) + b"abc", "texts of wrong lengths"),
    "Latin-1": (lengths(3, 0, 0, 1) + b"\xfc", "not in UTF-8"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_texts_are_bounded_before_they_are_made(store: Path, case: str) -> None:
    raw, words = TEXTS[case]
    forge_texts(store, raw)
    tracemalloc.start()
    for read in (lambda: export_study(store, store.parent / "a.csv"), lambda: open_study(store).load()):
        with pytest.raises(StudyError, match=f"task 0: reason .*{words}"):
            read()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 2.5 * MOST_CHUNK_BYTES


def test_a_task_of_many_texts_is_bounded_by_their_memory() -> None:
    """Each text of two letters takes ten times its bytes; what could not be read again is not written."""
    raw = lengths(5_000_000) + (lengths(2) + b"ab") * 5_000_000
    packed = zlib.compress(raw, 1, wbits=-zlib.MAX_WBITS)
    with pytest.raises(ChunkError, match=r"reason takes more than 256,000,000 bytes of memory"):
        texts_of("reason", packed, 5_000_000)
    with pytest.raises(ChunkError, match=r"takes more than 256,000,000 bytes of memory"):
        chunk_bytes(np.full(1000, "x" * 256_000), TEXT)


MORE = [{"name": f"v{i}", "dims": [], "inner": [], "dtype": "float64", "about": {}} for i in range(1000)]
OF_ANOTHER: dict[str, Callable[[Any], object]] = {
    "members": lambda made: made.update(shape=[10_000_000, 1], task=[1, 1]),
    "results": lambda made: made.update(variables=[*MORE, *made["variables"]]),
}


@pytest.mark.parametrize("case", OF_ANOTHER)
def test_a_layout_of_another_study_is_not_computed(store: Path, case: str) -> None:
    """Millions of tasks, or thousands of results, that the study has not."""
    forge(store, OF_ANOTHER[case])
    before = sorted(store.rglob("*"))
    with pytest.raises(StudyError, match="its layout is not that of the study"):
        ss.run_study(study_of_file(store.parent / "study.yaml"), store, workers=1)
    assert sorted(store.rglob("*")) == before


def test_a_damaged_description_is_said(store: Path) -> None:
    group = json.loads((store / "zarr.json").read_text())
    made = json.loads(group["attributes"]["study"])
    made["description"]["study"] = 5
    group["attributes"]["study"] = json.dumps(made)
    (store / "zarr.json").write_text(sealed(group))
    with pytest.raises(StudyError, match="its description is damaged"):
        study_picture(store, "value", "x")


def test_metadata_of_the_library_decide_nothing(store: Path) -> None:
    """Shapes and packing that are forged for other readers, with a seal that is right."""
    group = json.loads((store / "zarr.json").read_text())
    for one in group["consolidated_metadata"]["metadata"].values():
        one["shape"][0], one["codecs"] = 4 * 10**12, []
    (store / "zarr.json").write_text(sealed(group))
    assert open_study(store).load().sizes == {"x": 4, "y": 3}


def test_a_study_beyond_the_bounds_is_refused_before_it_is_stored(store: Path) -> None:
    """What could not be read again is not written."""
    there = Store(store)
    large = there.layout.variables[0]._replace(inner=(("time", 10_000_000),))
    layout = there.layout._replace(variables=(large, *there.layout.variables[1:]))
    with pytest.raises(QuantityError, match=r"240 MB of value; up to 128 MB .* fewer members a task"):
        create(store.parent / "new.zarr", there.description, layout, [], {}, "")
    with pytest.raises(QuantityError, match="its metadata would have 11 MB; up to 10 MB"):
        create(store.parent / "new.zarr", {"x": "y" * 11_000_000}, there.layout, [], {}, "")
    assert not (store.parent / "new.zarr").exists()
