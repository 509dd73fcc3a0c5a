"""What cannot be exported is refused in one line, and nothing is written; what can, from every source."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from export.building import compiled, output
from stickslip import load_actuator
from stickslip.cli import app
from stickslip.export import ExportError, export_c, export_fmu
from stickslip.identify.results import model_numbers
from stickslip.rig import load_bench
from stickslip.waveform.periodic import Sawtooth

KANG = load_actuator("kang2007")


def run(*arguments: str):
    return CliRunner().invoke(app, ["export", *arguments], prog_name="stickslip")


WRONG = {
    "set": ({"source": "kang2008"}, "no parameter set 'kang2008'"),
    "thing": ({"source": 3.0}, "a float cannot be exported"),
    "law": ({"source": KANG.friction}, "a LuGre cannot be exported"),
    "step": ({"step": "2 s"}, "step = 2 s is out of range"),
    "unit": ({"step": "2 V"}, "step = '2 V'"),
    "waveform": ({"waveform": Sawtooth(1e-6, 5, unit="m")}, "is in V, not in m"),
    "range": ({"waveform": Sawtooth(200, 5)}, "out of range"),
    "duration": ({"duration": -1.0}, "duration = -1 s"),
    "motion": ({"motion": Sawtooth(1.0, 5)}, "the wanted motion is in m"),
    "noise": ({"measurement_noise": 0.0}, "measurement_noise = 0 m must be > 0 m"),
    "two currents": (
        {
            "amplifier": load_bench("kang2007-bench").amplifier._replace(rms_current=0.01, peak_duration=1.0),
            "piezo_capacitance": 1e-6,
        },
        "rms_current = 0.01 A cannot be exported",
    ),
    "amplifier": ({"amplifier": load_bench("kang2007-bench").amplifier}, "needs the piezo_capacitance"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments(case, tmp_path) -> None:
    given, said = WRONG[case]
    with pytest.raises(ValueError, match=said.replace("(", r"\(")):
        export_c(**{"source": KANG, "out": tmp_path / "c", **given})
    assert not list(tmp_path.iterdir())


def test_what_exists_is_kept(tmp_path) -> None:
    for file in (tmp_path / "file", tmp_path / "folder" / "mine"):
        file.parent.mkdir(exist_ok=True)
        file.write_text("mine")
    for place in ("file", "folder"):
        with pytest.raises(ExportError, match="exists already"):
            export_c(KANG, tmp_path / place)
    wrong: Any
    for wrong in (None, 3):
        with pytest.raises(ExportError, match=f"out = {wrong}"):
            export_c(KANG, wrong)
    (tmp_path / "locked").write_text("")
    with pytest.raises(ExportError, match="cannot be written"):
        export_c(KANG, tmp_path / "locked" / "inside")
    assert {file.name for file in tmp_path.rglob("*")} == {"file", "folder", "mine", "locked"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"fmi": 1}, "versions 2 and 3"),
        ({"mode": "model"}, "plant, observer, feedforward"),
        ({"compiler": "no-such-compiler"}, "not installed"),
    ],
)
def test_wrong_fmu(given, said, tmp_path) -> None:
    with pytest.raises(ExportError, match=said):
        export_fmu(KANG, tmp_path / "fmu", **given)
    assert not list(tmp_path.iterdir())


def test_a_compiler_that_fails_leaves_nothing(tmp_path) -> None:
    with pytest.raises(ExportError, match="could not compile"):
        export_fmu(KANG, tmp_path / "fmu", compiler="false")
    assert not list(tmp_path.iterdir())


def test_results_of_an_identification(tmp_path) -> None:
    model = KANG.replace(friction=KANG.friction._replace(coulomb_force=0.5, stiction_force=0.5))
    numbers = {
        "model": model_numbers(model),
        "parameters": {"coulomb_force": {"value": 0.5, "unit": "N", "standard_error": 0.01}},
    }
    results = tmp_path / "results.json"
    results.write_text(json.dumps({"numbers": numbers}))
    export_c(str(results), tmp_path / "c", duration=0.2)
    text = (tmp_path / "c" / "stickslip_parameters.c").read_text()
    assert "coulomb_force = R(0.5); /* N, F_C: Coulomb friction; fitted, standard error 0.01 */" in text
    assert "stiction_force = R(0.5); /* N, F_S: stiction; changed since kang2007 was loaded */" in text
    assert "ASSUMED: brass with a metal block" in text
    assert "eq. 5.10" in text
    results.write_text(json.dumps({"numbers": {"parameters": {}}}))
    with pytest.raises(ExportError, match="holds no actuator"):
        export_c(str(results), tmp_path / "d")
    with pytest.raises(ExportError, match="cannot be read"):
        export_c(str(tmp_path / "no.json"), tmp_path / "d")
    numbers["model"]["friction"]["sigma_0"]["value"] = -1.0
    results.write_text(json.dumps({"numbers": numbers}))
    with pytest.raises(ExportError, match=r"LuGre\.sigma_0 = -1 N/m is out of range"):
        export_c(str(results), tmp_path / "d")
    numbers["model"] = model_numbers(model)
    for part, wrong in (("parameters", {"coulomb_force": 0.5}), ("signal_chain", [1]), ("model", [])):
        results.write_text(json.dumps({"numbers": {**numbers, part: wrong}}))
        with pytest.raises(ExportError, match=re.escape(f"{results}: ")):
            export_c(str(results), tmp_path / "d")
    assert not (tmp_path / "d").exists()


def test_commands(tmp_path) -> None:
    made = run(
        "c",
        "kang2007",
        "--out",
        str(tmp_path / "c"),
        "--amplitude",
        "40 V",
        "--frequency",
        "10 Hz",
        "--periods",
        "2",
    )
    assert made.exit_code == 0, made.stderr
    table = output(compiled(tmp_path / "c", tmp_path / "c" / "host" / "walk.c"))
    columns = np.genfromtxt(io.StringIO(table), delimiter=",", names=True)
    assert columns["time"][-1] == pytest.approx(0.2)
    assert columns["drive_voltage"].max() == pytest.approx(40.0)
    assert (
        run("fmu", "kang2007", "--fmi", "3", "--mode", "observer", "--out", str(tmp_path / "fmu")).exit_code
        == 0
    )
    assert [file.name for file in (tmp_path / "fmu").iterdir()] == ["kang2007_observer.fmu"]
    behind = run("c", "kang2007", "--bench", "kang2007-bench", "--out", str(tmp_path / "bench"))
    assert behind.exit_code == 0
    table = output(compiled(tmp_path / "bench", tmp_path / "bench" / "host" / "walk.c"))
    columns = np.genfromtxt(io.StringIO(table), delimiter=",", names=True)
    assert columns["drive_voltage"].max() == pytest.approx(65.0, abs=0.5)
    again = run("c", "kang2007", "--out", str(tmp_path / "c"))
    lone = run("c", "kang2007", "--frequency", "0 Hz", "--out", str(tmp_path / "lone"))
    assert (lone.exit_code, "--amplitude is missing" in lone.stderr) == (2, True)
    assert again.exit_code == 2
    assert again.stderr == f"Error: {tmp_path / 'c'} exists already; nothing was written\n"
    assert run("fmu", "kang2007", "--fmi", "4", "--out", str(tmp_path / "x")).exit_code == 2
    assert not Path(tmp_path / "x").exists()


@pytest.mark.usefixtures("full_disk")
@pytest.mark.parametrize("kind", ["c", "fmu"])
def test_a_full_disk_is_named_and_nothing_stays(kind: str, tmp_path: Path) -> None:
    done = run(kind, "kang2007", "--out", str(tmp_path / "out"))
    assert (done.exit_code, done.stderr) == (1, f"Error: {tmp_path / 'out'}: File too large\n")
    assert not list(tmp_path.iterdir())
