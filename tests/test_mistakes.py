"""Sixty mistakes of newcomers: each message says what is wrong, where, and what to do next."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.study import Grid, SteadySteps, Study, export_study

KANG = ss.load_actuator("kang2007")
BENCH = ss.load_bench("kang2007-bench")
ENDLESS = ss.Sawtooth("65 V", "5 Hz")
DRIVE = ENDLESS._replace(periods=1)
WALK = ss.simulate(KANG, DRIVE, sample_rate=1e3)
LIMITS = ss.Limits(max_voltage="20 V")
ONE_MEMBER = Study(Grid({"frequency": [5.0]}), SteadySteps(KANG, ENDLESS))
CAPTURE = ss.Capture("0.1 s", interval="50 us")

CAMPAIGN = """\
title: A walk
model: kang2007
free: [sigma_0]
recordings: [{file: walk.csv, use: fit}]
"""
FILES = {
    "empty.csv": "",
    "header.csv": "t [s],x [um]\n",
    "words.csv": "t [s],x [um]\n0,1\n1,two\n2,3\n",
    "unit.csv": "t [s],x [blorb]\n" + "".join(f"{i},{i}\n" for i in range(50)),
    "walk.csv": "t [s],x [um],u [V]\n" + "".join(f"{1e-3 * i},{np.sin(i)},{i % 50}\n" for i in range(99)),
    "broken.yaml": "title: [a, b\nkind: walk\n",
    "campaign.yaml": CAMPAIGN,
    "analysis.yaml": "kind: walk\n" + CAMPAIGN,
    "typo.yaml": "kind: walk\n" + CAMPAIGN.replace("free", "freee"),
    "gone.yaml": CAMPAIGN.replace("walk.csv", "wlk.csv"),
    "unknown.yaml": CAMPAIGN.replace("kang2007", "kang2008"),
    "job.yaml": "steps: [{recrd: experiment.yaml}]\n",
    "step.yaml": "steps: [{identify: campain.yaml}]\n",
    "results.json": "{}",
    "notes.txt": "a note",
    "broken.toml": "[gain\nvalue = 1\n",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with files that are wrong in one way each."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(200))
    (tmp_path / "folder").mkdir()
    published = Path(ss.parameters.__path__[0], "sets", "kang2007.toml").read_text(encoding="utf-8")
    (tmp_path / "set.toml").write_text(
        re.sub('unit = "[un]m/V"', 'unit = "um/N"', published), encoding="utf-8"
    )
    return tmp_path


def recorded(inputs: dict[str, ss.Channel]) -> Any:
    return ss.measure(ss.VirtualRig(KANG, BENCH), DRIVE, inputs, CAPTURE, LIMITS)


# What is called; and what its message contains: what is wrong, where, what to do next.
PYTHON: dict[str, tuple[Callable[[], Any], tuple[str, str, str]]] = {
    "a name as a model": (
        lambda: ss.simulate("kang2007", DRIVE),  # type: ignore[arg-type]
        ("not str", "a model", "ss.load_actuator('kang2007')"),
    ),
    "model and drive swapped": (
        lambda: ss.simulate(DRIVE, KANG),  # type: ignore[arg-type]
        ("not a Actuator", "the drive", "is a waveform"),
    ),
    "a mistyped call": (
        lambda: ss.load_actuators("kang2007"),  # type: ignore[attr-defined]
        ("no 'load_actuators'", "stickslip", "did you mean 'load_actuator'?"),
    ),
    "a mistyped call of a room": (
        lambda: ss.design.step_tabel(WALK),  # type: ignore[attr-defined]
        ("no 'step_tabel'", "stickslip.design", "did you mean 'step_table'?"),
    ),
    "an unknown set": (
        lambda: ss.load_actuator("kang2008"),
        ("no parameter set", "'kang2008'", "did you mean 'kang2007'?"),
    ),
    "a set that is no TOML": (
        lambda: ss.load_actuator("broken.toml"),
        ("no valid TOML", "broken.toml", "Expected ']'"),
    ),
    "a set with a wrong unit": (lambda: ss.load_actuator("set.toml"), ("um/N", "gain", "expected m/V")),
    "a wrong unit": (
        lambda: ss.Sawtooth("65 N", "5 Hz"),
        ("the unit 'N'", "Sawtooth.amplitude", "expected V"),
    ),
    "an unknown unit": (
        lambda: ss.Sawtooth("65 Vx", "5 Hz"),
        ("unknown unit 'Vx'", "Sawtooth.amplitude", "expected V"),
    ),
    "a negative frequency": (
        lambda: ss.Sawtooth("65 V", "-5 Hz"),
        ("out of range", "Sawtooth.frequency", "must be > 0 Hz"),
    ),
    "no duration": (lambda: ss.simulate(KANG, ENDLESS), ("missing", "duration", "Give the duration")),
    "volts for seconds": (lambda: ss.simulate(KANG, ENDLESS, "1 V"), ("'V'", "duration", "expected s")),
    "more volts than allowed": (
        lambda: ss.simulate(KANG, DRIVE._replace(amplitude=500.0)),
        ("out of range", "drive voltage", "takes 0 V to 150 V"),
    ),
    "an unknown field": (
        lambda: KANG.replace(mas="1 kg"),
        ("no field 'mas'", "Actuator", "end_effector_mass"),
    ),
    "a mistyped field": (
        lambda: ss.LuGre(sigma0=1e6),  # type: ignore[call-arg]
        ("no field 'sigma0'", "LuGre", "did you mean 'sigma_0'?"),
    ),
    "a steady step of a step": (
        lambda: ss.steady_step(KANG, ss.Step("60 V")),
        ("no period", "Step", "such as Sawtooth"),
    ),
    "an unknown member": (
        lambda: ss.simulate_ensemble(KANG, DRIVE, parameters={"sigma0": [1e6, 2e6]}),
        ("cannot vary", "'sigma0'", "did you mean 'sigma_0'?"),
    ),
    "members of two lengths": (
        lambda: ss.simulate_ensemble(KANG, DRIVE, parameters={"sigma_0": [1e6], "sigma_1": [1.0, 2.0]}),
        ("one length", "parameters", "'sigma_1': 2"),
    ),
    "a mistyped free parameter": (
        lambda: ss.identify_friction([WALK], KANG, ["sigma0"], drive=DRIVE),
        ("cannot be free", "'sigma0'", "did you mean 'sigma_0'?"),
    ),
    "no drive": (
        lambda: ss.identify_friction([WALK.drop_vars("drive_voltage")], KANG, ["sigma_0"]),
        ("no drive_voltage", "simulation of kang2007", "give drive="),
    ),
    "no recording": (
        lambda: ss.identify_friction([DRIVE], KANG, ["sigma_0"]),  # type: ignore[list-item]
        ("is a Sawtooth", "recording 1", "ss.read_recording"),
    ),
    "an empty list": (
        lambda: ss.verify(ss.identify.Predictor(KANG), []),
        ("empty", "recordings", "give at least one"),
    ),
    "arguments of verify swapped": (
        lambda: ss.verify(WALK, KANG),  # type: ignore[arg-type]
        ("no fit", "Dataset", "Predictor(actuator)"),
    ),
    "a missing file": (
        lambda: ss.read_recording("wlk.csv"),
        ("no such file", "wlk.csv", "did you mean 'walk.csv'?"),
    ),
    "a missing folder": (
        lambda: ss.read_recording("data/walk.csv"),
        ("no such file", "data/walk.csv", "the folder data is missing"),
    ),
    "a folder": (lambda: ss.read_recording("folder"), ("is a folder", "folder", "name a file in it")),
    "an unknown column": (
        lambda: ss.read_recording("walk.csv", {"time": "t", "end_effector_position": "pos"}),
        ("no column 'pos'", "walk.csv", "1: 'x [um]'"),
    ),
    "an unknown unit in a file": (
        lambda: ss.read_recording("unit.csv", {"time": "t", "end_effector_position": "x"}),
        ("'blorb'", "unit.csv", "units="),
    ),
    "an empty file": (lambda: ss.read_recording("empty.csv"), ("empty", "empty.csv", "export it again")),
    "a header alone": (
        lambda: ss.read_recording("header.csv"),
        ("no rows of numbers", "header.csv", "in the first 2 lines"),
    ),
    "a word in a column": (
        lambda: ss.read_recording("words.csv"),
        ("not a number", "words.csv: line 3, column 'x [um]'", "'two'"),
    ),
    "a picture": (
        lambda: ss.read_recording("picture.png"),
        ("a picture", "picture.png", "save the numbers behind it as CSV"),
    ),
    "a table as a recording of ours": (
        lambda: ss.open_recording("walk.csv"),
        ("not a readable NetCDF 4 file", "walk.csv", "ss.read_recording"),
    ),
    "a table as a fit": (lambda: ss.load_fit("walk.csv"), ("no fit", "walk.csv", "ss.save_fit writes one")),
    "a dictionary as a recording": (
        lambda: ss.save_recording({"time": [0.0]}, "a.nc"),  # type: ignore[arg-type]
        ("no recording", "a dict", "make_recording makes one"),
    ),
    "lengths that differ": (
        lambda: ss.make_recording([0.0, 1.0, 2.0], {"end_effector_position": [0.0, 1.0]}),
        ("has the shape (2,)", "end_effector_position", "time has (3,)"),
    ),
    "time that goes back": (
        lambda: ss.make_recording([0.0, 2.0, 1.0], {"end_effector_position": [0.0, 1.0, 2.0]}),
        ("does not increase", "sample 2", "1 s after 2 s"),
    ),
    "an unknown input": (
        lambda: recorded({"end_effector_position": ss.Channel("laser")}),
        ("laser", "end_effector_position", "interferometer"),
    ),
    "a drive beyond the limits": (
        lambda: recorded({"drive_voltage": ss.Channel("drive")}),
        ("32.5 V", "above the greatest voltage of 20 V", "change the drive or the limits"),
    ),
    "an unknown bench": (lambda: ss.load_bench("kang"), ("no bench", "'kang'", "kang2007-bench")),
    "an unknown goal": (
        lambda: ss.optimise_waveform(KANG, goal="sped", max_voltage="100 V"),
        ("is unknown", "goal 'sped'", "did you mean 'speed'?"),
    ),
    "volts for hertz": (
        lambda: ss.step_map(KANG, voltage="60 V", frequency="5 V"),
        ("the unit 'V'", "frequency", "expected Hz"),
    ),
    "volts for a rate": (
        lambda: ss.control.tune(KANG, "20 V"),
        ("the unit 'V'", "update_rate", "expected Hz"),
    ),
    "a number as a picture": (lambda: ss.plot(3), ("cannot be drawn", "int", "give a fit")),
    "a recording as a system": (
        lambda: ss.bode(WALK),
        ("no frequency response", "Dataset", "drawn by ss.plot"),
    ),
    "an unknown reference": (
        lambda: ss.parameters.cite("nobody"),
        ("no reference", "'nobody'", "`stickslip list` shows names"),
    ),
    "an unknown version": (
        lambda: ss.export.export_fmu(KANG, "out", fmi=4),
        ("known are", "fmi = 4", "2 and 3"),
    ),
}

# Arguments of the command `stickslip`.
COMMANDS: dict[str, tuple[str, str, str]] = {
    "simulat kang2007": ("No such command", "'simulat'", "Did you mean 'simulate'?"),
    "simulate kang2007 --amplitde 65V": ("No such option", "--amplitde", "--amplitude"),
    "simulate kang2007 --set sigma0=3": ("no field 'sigma0'", "Actuator", "friction"),
    "simulate --waveform sawtoth": ("no waveform", "'Sawtoth'", "did you mean 'Sawtooth'?"),
    "verify walk.csv walk.csv": ("the first argument", "walk.csv", "results.json of an identification"),
    "verify results.json walk.csv": ("no results of an identification", "results.json", "stickslip identify"),
    "verify results.json wlk.csv": ("does not exist", "'wlk.csv'", "stickslip verify --help"),
    "identify campaign.yaml": ("kind is missing", "campaign.yaml", "`stickslip campaign`"),
    "campaign analysis.yaml": ("no field 'kind'", "analysis.yaml", "`stickslip identify`"),
    "record campaign.yaml": ("no field 'model'", "campaign.yaml", "`stickslip campaign`"),
    "design campaign.yaml": ("no field 'free'", "campaign.yaml", "`stickslip campaign`"),
    "move campaign.yaml": ("no field 'free'", "campaign.yaml", "`stickslip campaign`"),
    "study campaign.yaml --store s.zarr": ("no field 'free'", "campaign.yaml", "`stickslip campaign`"),
    "study gone.yaml": ("Missing option", "--store", "stickslip study run --help"),
    "run walk.csv": ("must be a mapping", "walk.csv", "stickslip new campaign"),
    "run broken.yaml": ("no YAML", "line 1, column 8", "Check brackets"),
    "run typo.yaml": ("no field 'freee'", "typo.yaml", "did you mean 'free'?"),
    "run job.yaml": ("no step 'recrd'", "job.yaml: steps.0", "did you mean 'record'?"),
    "run step.yaml": ("no such file", "step.yaml: steps.0.identify", "did you mean 'campaign.yaml'?"),
    "campaign gone.yaml": ("no such file", "wlk.csv", "did you mean 'walk.csv'?"),
    "campaign unknown.yaml": ("no parameter set", "'kang2008'", "did you mean 'kang2007'?"),
    "inspect folder": ("is a folder", "folder", "name a file in it"),
    "new campain walk.csv": ("no kind", "'campain'", "did you mean 'campaign'?"),
    "new campaign walk.csv": ("there already", "campaign.yaml", "--out names another"),
    "panel --port 99999": ("less than or equal to 65535", "'--port'", "stickslip panel --help"),
    "panel notes.txt": ("is a file", "'notes.txt'", "stickslip panel --help"),
    "runs nowhere": ("no such folder", "nowhere", "name the folder of your recordings"),
    "runs notes.txt": ("is a file, not a folder", "notes.txt", "name the folder of your recordings"),
    "twin mcs3": ("no twin", "'mcs3'", "did you mean 'mcs2'?"),
    "rigs --at nowhere.invalid": ("no host", "nowhere.invalid", "check name and network"),
    "list lawz": ("no kind", "'lawz'", "did you mean 'laws'?"),
    "calibrate nowhere": ("No such file", "nowhere", "tables known by name"),
    "demo --out notes.txt": ("is a file, not a folder", "notes.txt", "name another folder"),
    # Nobody, not even root, can make a folder there.
    "demo --out /proc/nowhere/out": ("No such file", "--out /proc/nowhere/out", "name another folder"),
}


def check(message: str, parts: tuple[str, str, str]) -> None:
    for part, question in zip(parts, ("what is wrong", "where", "what to do"), strict=True):
        assert part in message, f"{question}: {part!r} is not in {message!r}"


def test_there_are_enough() -> None:
    assert len(PYTHON) + len(COMMANDS) >= 60


@pytest.mark.parametrize("name", PYTHON)
def test_a_mistake_in_python(folder: Path, name: str) -> None:
    call, parts = PYTHON[name]
    with pytest.raises((ValueError, TypeError, AttributeError, ss.rig.LimitError)) as raised:
        call()
    check(str(raised.value), parts)


@pytest.mark.parametrize("line", COMMANDS)
def test_a_mistake_on_the_command_line(folder: Path, line: str) -> None:
    done = CliRunner().invoke(app, line.split(), prog_name="stickslip")
    assert done.exit_code in (1, 2)
    assert "Traceback" not in done.output
    check(re.sub(r"\s+", " ", done.output), COMMANDS[line])


@pytest.mark.parametrize(
    ("module", "call", "parts"),
    [
        (
            "control",
            lambda: KANG.state_space().to_control(),
            ("needs python-control", "to_control", "pip install 'stickslip[control]'"),
        ),
        (
            "nptdms",
            lambda: ss.read_recording("a.tdms"),
            ("npTDMS", "a.tdms", "pip install 'stickslip[labview]'"),
        ),
        (
            "zarr",
            lambda: ss.run_study(ONE_MEMBER, "s.zarr", workers=1),
            ("needs zarr", "a stored study", 'pip install "stickslip[study]"'),
        ),
        (
            "pyarrow",
            lambda: (
                ss.run_study(ONE_MEMBER, "s.zarr", workers=1),
                export_study("s.zarr", "members.parquet"),
            ),
            ("needs pyarrow", "Parquet", 'pip install "stickslip[parquet]"'),
        ),
    ],
)
def test_a_missing_extra(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    call: Callable[[], Any],
    parts: tuple[str, str, str],
) -> None:
    (folder / "a.tdms").write_bytes(b"TDSm" + bytes(200))
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises((ValueError, ImportError)) as raised:
        call()
    check(str(raised.value), parts)
