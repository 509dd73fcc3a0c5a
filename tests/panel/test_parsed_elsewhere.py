"""No text of the panel's folder is parsed in the server's process: a file must not end, or hold up, a run."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

import stickslip as ss
from stickslip.gate import text, yaml_text
from stickslip.history.acts import note_act
from stickslip.identify.results import model_numbers
from stickslip.panel import create_app
from stickslip.panel.document import DEFAULT
from stickslip.panel.server import READ_BY
from stickslip.recording.calibration import load_calibration, save_calibration
from stickslip.rig.bench import _BENCHES

from .serving import ME, client_of
from .test_saved_sets import BRASS, save_set

FIT = "fits/2026-01-05_10-00-00"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A lab with a text of every kind that pages ask for."""
    (tmp_path / "parameters").mkdir()
    save_set(tmp_path, BRASS, sigma_1=30.0)
    (tmp_path / FIT).mkdir(parents=True)
    model = model_numbers(ss.load_actuator("kang2007"))
    numbers = {"model": model, "parameters": {"sigma_0": {"standard_error": 1.0}}}
    (tmp_path / FIT / "results.json").write_text(json.dumps({"numbers": numbers, "summary": "Good."}))
    asked = {"recordings": ["x.nc"], "set": BRASS, "law": "LuGre", "friction": {}, "free": ["sigma_0"]}
    shown = {"phase": "done", "doing": "", "request": asked}
    (tmp_path / FIT / "shown.json").write_text(json.dumps(shown))
    (tmp_path / FIT / "report.html").touch()
    (tmp_path / FIT / "notes.json").write_text('{"notes": "warm"}')
    (tmp_path / ".stickslip").mkdir()
    alarm = {"statistic": "step", "low": "1 um", "high": None, "stop": False}
    (tmp_path / ".stickslip" / "alarms.json").write_text(json.dumps({"alarms": [alarm]}))
    note_act(tmp_path, "exported", FIT, kind="csv")
    shutil.copy(_BENCHES / "kang2007-bench.toml", tmp_path / "own.toml")
    save_calibration(load_calibration("kang2007-strain-gauge"), tmp_path / "gauge.json")
    content = DEFAULT.read_text().replace("calibration: [kang2007-strain-gauge]", "calibration: [gauge.json]")
    (tmp_path / "e.yaml").write_text(content)
    return tmp_path


@pytest.fixture
def parsed(monkeypatch: pytest.MonkeyPatch, folder: Path) -> list[str]:
    """Sources in the folder that this process, the server's, parses."""
    found: list[str] = []
    for module, name, at in ((text, "_check_json", 1), (text, "_check_toml", 1), (yaml_text, "decoded", 1)):
        original = getattr(module, name)

        def noted(*given: object, original: object = original, at: int = at) -> object:
            if str(given[at]).startswith((str(folder), "acts.jsonl")):
                found.append(str(given[at]))
            return original(*given)  # type: ignore[operator]

        monkeypatch.setattr(module, name, noted)
    return found


@pytest.fixture
def client(folder: Path, parsed: list[str]) -> Iterator[httpx.Client]:
    with client_of(create_app(folder), **ME) as made:
        yield made


def test_every_text_is_parsed_by_the_process_that_reads(
    client: httpx.Client, folder: Path, parsed: list[str]
) -> None:
    assert client.get("/api/identify/state").json()["request"]["set"] == BRASS
    assert {row["name"]: row["problem"] for row in client.get("/history").json()["rows"]}[FIT] == ""
    (act,) = client.post("/history/detail", json={"name": FIT}).json()["acts"]
    assert (act["act"], act["kind"]) == ("exported", "csv")
    assert client.post("/history/annotate", json={"name": FIT, "tags": ["x"]}).status_code == 200
    assert BRASS in client.get("/api/explore/choices").text
    assert any(one.get("bench") == "own.toml" for one in client.get("/bench/rigs").json()["rigs"])
    loaded = client.post("/bench/load", json={"name": "e.yaml"})
    assert loaded.status_code == 200, loaded.text
    saved = client.post("/path/save", json={"fit": FIT, "name": "copper"})
    assert saved.status_code == 200, saved.text
    copper = ss.load_actuator(folder / "parameters" / "copper.toml")
    assert copper.friction == ss.load_actuator("kang2007").friction
    assert parsed == []
    text.load_json(b"{}", str(folder))
    assert parsed == [str(folder)]  # what is watched for is seen


ASKED = """
import sys
from importlib import import_module
from pathlib import Path
fit, saved = Path(sys.argv[1]), Path(sys.argv[2])
for name in sys.argv[3:]:
    import_module(name)
before = {*sys.modules}
from stickslip.jobs.analysis.fit_parameters import fit_parameters, results_summary
from stickslip.history.describing import described_fit, described_set
fit_parameters(fit, "x", "y")
results_summary(fit)
described_fit(fit)
described_set(saved)
print([one for one in sorted({*sys.modules} - before) if one.startswith(("stickslip.", "scipy.", "xarray."))])
"""


def test_the_first_question_finds_its_modules_imported(folder: Path) -> None:
    """The process that reads files imports them while the server starts, for the first question waits."""
    results, saved = folder / FIT / "results.json", folder / f"{BRASS}"
    done = subprocess.run(
        [sys.executable, "-c", ASKED, results, saved, *READ_BY], capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.returncode) == ("[]\n", 0), done.stderr
