"""The command line, in this process where that does, in a process of its own where it matters."""

from __future__ import annotations

import html
import json
import os
import pty
import re
import resource
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stickslip import __version__
from stickslip.cli import app
from stickslip.cli.frame import check_output, progress_bar
from stickslip.physics.actuator import load_actuator
from stickslip.recording import make_recording, open_recording, save_recording
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth

# No steady step to solve for.
STEP = ["simulate", "kang2007", "--waveform", "step", "--amplitude", "65 V", "--duration", "10 ms"]
THESIS = ["simulate", "kang2007", "--amplitude", "65 V", "--frequency", "5 Hz", "--periods", "2"]


def run(*arguments: str):
    return CliRunner().invoke(app, [*arguments], prog_name="stickslip")


def python(program: str, *arguments: str, **how) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, **how)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


def test_version_and_help() -> None:
    assert run("--version").stdout == f"stickslip {__version__}\n"
    listed = run("--help").stdout
    assert all(command in listed for command in ("simulate", "identify", "demo", "cite"))
    options = run("simulate", "--help").stdout
    assert all(
        name in options for name in ("--waveform", "--amplitude", "--set", "--sample-rate", "--tolerance")
    )


def test_the_shell_completes_commands_and_names() -> None:
    """What the shell's script asks: `stickslip --show-completion` prints that."""
    for words, found in (
        ("simulate kang", ["kang2007", "kang2007-hysteresis"]),
        ("simulate --law Lu", ["LuGre"]),
        ("simulate --waveform reverse", ["reverse-sawtooth"]),
        ("export c --bench k", ["kang2007-bench", "kang2007-hysteresis-bench"]),
        ("export c col", ["colas2019"]),
        ("calibrate --after kang2007-s", ["kang2007-strain-gauge"]),
        ("cite Dah", ["Dahl"]),
        ("list la", ["laws"]),
        ("new camp", ["campaign"]),
        ("verif", ["verify"]),
        ("simulate --set end", ["end_effector_mass="]),
        ("simulate --set friction.st", ["friction.stiction_force=", "friction.stribeck_velocity="]),
        ("simulate --law Dahl --set friction.e", ["friction.exponent="]),
        ("simulate --waveform ramp --set waveform.rat", ["waveform.rate="]),
        ("simulate pohl1987 --set stage_r", ["stage_reaction="]),
        ("simulate nowhere --set e", []),
    ):
        asked = {"COMP_WORDS": f"stickslip {words}", "COMP_CWORD": str(len(words.split()))}
        environment = {"_STICKSLIP_COMPLETE": "complete_bash", **asked}
        assert CliRunner().invoke(app, [], prog_name="stickslip", env=environment).stdout.split() == found


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shells_script_is_shown(shell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")  # of the shell that runs this
    words = ["--show-completion", shell]
    done = python(f"from stickslip.cli import app; app({words}, prog_name='stickslip')")
    assert done.returncode == 0, done.stderr
    assert f"_STICKSLIP_COMPLETE=complete_{shell}" in done.stdout


def test_help_does_not_wait_for_the_solver() -> None:
    program = (
        "import sys\nfrom stickslip.cli import app\napp(['--help'], standalone_mode=False)\n"
        "print(sorted({'numba', 'numpy', 'xarray', 'matplotlib', 'rich', 'pint'} & set(sys.modules)))"
    )
    assert python(program).stdout.splitlines()[-1] == "[]"


def test_list_and_a_first_simulation_import_only_what_they_need() -> None:
    heavy = {
        "xarray",
        "pandas",
        "h5py",
        "scipy.optimize",
        "scipy.linalg",
        "matplotlib",
        "yaml",
        "pint",
        "dask",
    }
    listed = "from stickslip.cli import app\napp(['list'], standalone_mode=False)"
    drive = "ss.Sawtooth(amplitude=65.0, frequency=5.0)"
    simulated = f"import stickslip as ss\nss.simulate(ss.load_actuator('kang2007'), {drive}, 0.4)"
    for program, needed in ((listed, set()), (simulated, {"xarray", "pandas"})):
        done = python(f"{program}\nimport sys\nprint(sorted({heavy - needed} & set(sys.modules)))")
        assert done.stdout.splitlines()[-1] == "[]", done.stderr


def test_simulate(tmp_path: Path) -> None:
    out = tmp_path / "a" / "b"
    done = run(*THESIS, "--out", str(out), "--sample-rate", "2 kHz")
    assert done.exit_code == 0, done.stderr
    assert str(out / "report.html") in done.stdout
    assert contents(out).keys() == {"report.html", "results.json", "trajectory.nc", "figures/trajectory.svg"}
    trajectory = open_recording(out / "trajectory.nc")
    assert trajectory["time"].size == 801
    results = json.loads((out / "results.json").read_bytes())
    assert results["numbers"]["net_displacement"] == {
        "value": float(trajectory["end_effector_position"][-1] - trajectory["end_effector_position"][0]),
        "unit": "m",
    }
    # The thesis's actuator walks some 3 um a step forward at 65 V.
    assert 2e-6 < results["numbers"]["steady_step"]["value"] < 5e-6
    assert results["numbers"]["parameters"]["friction.sigma_0"] == {"value": 1.399e6, "unit": "N/m"}


def test_changes_of_parameters_reach_the_simulation(tmp_path: Path) -> None:
    changes = [
        "friction.sigma_0=1.5 N/um",
        "end_effector_mass=0.12kg",
        "stage_reaction=no",
        "waveform.offset=5V",
    ]
    options = [word for change in changes for word in ("--set", change)]
    assert run(*THESIS, *options, "--duration", "20 ms", "--out", str(tmp_path)).exit_code == 0
    numbers = json.loads((tmp_path / "results.json").read_bytes())["numbers"]
    assert numbers["parameters"]["friction.sigma_0"]["value"] == 1.5e6
    assert numbers["parameters"]["end_effector_mass"]["value"] == 0.12
    assert numbers["parameters"]["stage_reaction"] == "no"
    assert numbers["drive"]["offset"] == {"value": 5.0, "unit": "V"}
    assert numbers["duration"] == {"value": 0.02, "unit": "s"}


def test_limits_that_have_to_change_together_do(tmp_path: Path) -> None:
    forces = ["--set", "friction.coulomb_force=0.7", "--set", "friction.stiction_force=0.8 N"]
    assert run(*STEP, *forces, "--out", str(tmp_path)).exit_code == 0


def test_without_a_periodic_motion_the_step_is_null_with_the_reason(tmp_path: Path) -> None:
    """A force above the friction pulls the end-effector away for ever."""
    pull = ["--set", "external_force=1 N", "--duration", "10 ms"]
    done = run(*THESIS, *pull, "--out", str(tmp_path))
    assert done.exit_code == 0, done.stderr
    step = json.loads((tmp_path / "results.json").read_bytes())["numbers"]["steady_step"]
    assert step["value"] is None
    assert step["unit"] == "m"
    assert step["reason"] in done.stdout


def test_a_slider_pulled_by_a_user_s_own_set(tmp_path: Path) -> None:
    values = {
        "mass": ("30 g", "mass"),
        "spring_stiffness": ("168 N/m", "stiffness"),
        "damping": ("1 N s/m", "damping"),
        "friction.sigma_0": ("100 N/mm", "stiffness"),
        "friction.sigma_1": ("10 N s/m", "damping"),
        "friction.coulomb_force": ("10 mN", "force"),
        "friction.stiction_force": ("10 mN", "force"),
        "friction.stribeck_velocity": ("1 mm/s", "velocity"),
        "friction.sigma_2": ("0 N s/m", "damping"),
    }
    lines = ['title = "Slider"', "citations = []", 'kind = "pulled_slider"', "[friction]", 'law = "LuGre"']
    for field, (value, source) in values.items():
        number, _, unit = value.partition(" ")
        lines += [f"[{field}]", f"value = {number}", f'unit = "{unit}"', f'source = "{source}"']
    file = tmp_path / "slider.toml"
    file.write_text("\n".join(lines))
    pull = ["--waveform", "ramp", "--set", "waveform.rate=0.2 mm/s", "--duration", "1 s"]
    done = run("simulate", str(file), *pull, "--out", str(tmp_path / "out"))
    assert done.exit_code == 0, done.stderr
    numbers = json.loads((tmp_path / "out" / "results.json").read_bytes())["numbers"]
    # In steady sliding the slider hangs behind by what stretches the spring to the friction force, F_C/k.
    assert numbers["net_displacement"]["value"] == pytest.approx(2e-4 - 0.01 / 168, abs=2e-6)
    assert numbers["drive"]["rate"] == {"value": pytest.approx(2e-4), "unit": "m/s"}
    assert "steady_step" not in numbers


def test_wrong_input_is_one_line_and_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("an earlier report")
    before = contents(tmp_path)
    for arguments, words in (
        (["simulate", "nowhere.toml"], "nowhere.toml cannot be read"),
        (["simulate"], "--amplitude is missing: amplitude of the sawtooth, in V"),
        (["simulate", "--amplitude", "65 V"], "--frequency is missing: frequency of the sawtooth, in Hz"),
        (["simulate", "--waveform", "chirp", "--amplitude", "1 V"], "--set waveform."),
        ([*THESIS, "--amplitude", "65 N"], "Sawtooth.amplitude = '65 N' has the unit 'N', which is no V"),
        ([*THESIS, "--amplitude", "200 V"], "from 0 V to 200 V is out of range"),
        ([*THESIS, "--waveform", "step"], "Step has no field 'frequency'"),
        ([*THESIS, "--waveform", "swtooth"], "no waveform 'Swtooth' (did you mean 'Sawtooth'?)"),
        ([*THESIS, "--sample-rate", "1 kV"], "--sample-rate = '1 kV'"),
        ([*THESIS, "--set", "friction.sigma0=1"], "LuGre has no field 'sigma0' (did you mean 'sigma_0'?)"),
        (["simulate", "kang2008"], "no parameter set 'kang2008' (did you mean 'kang2007'?)"),
        (
            [*THESIS, "--duration", "1e9 s"],
            "--duration of 1e+09 s at --sample-rate of 1000 Hz: 1e+12",
        ),
        ([*THESIS, "--sample-rate", "1e15 Hz"], "at --sample-rate of 1e+15 Hz"),
        ([*THESIS, "--periods", "1e12"], "samples; a trajectory has up to 10,000,000"),
        ([*THESIS, "--set", "end_effector_mass"], "--set end_effector_mass: write FIELD=VALUE"),
        ([*THESIS, "--set", "stage.mass=1"], "--set stage.mass=1: write FIELD=VALUE"),
        ([*THESIS, "--set", "friction=Dahl"], "--set friction=Dahl: another law is --law Dahl; a value of"),
        ([*THESIS, "--set", "friction.law=Dahl"], "--set friction.law=Dahl: another law is --law Dahl"),
        ([*THESIS, "--set", "name=pohl1987"], "the name is that of the parameter set, which comes first: "),
        ([*THESIS, "--set", "waveform=step"], "--set waveform=step: another drive is --waveform step"),
        ([*THESIS, "--set", "frequency=5 Hz"], "--set frequency=5 Hz: of the drive it is --frequency '5 Hz'"),
        ([*THESIS, "--set", "stage_reaction=maybe"], "stage_reaction = 'maybe' must be True or False"),
        ([*THESIS, "--set", "friction.coulomb_force=0.9 N"], "stiction_force"),
        (["identify", "nowhere.yaml"], "nowhere.yaml"),
        (["cite", "kang207"], "kang207"),
        (["simulat"], "simulat"),
    ):
        out = ["--out", str(tmp_path)] if arguments[0] in ("simulate", "identify") else []
        done = run(*arguments, *out)
        assert done.exit_code == 2
        assert done.stdout == ""
        assert "Traceback" not in done.stderr
        errors = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
        assert len(errors) == 1
        assert words in errors[0]
        assert contents(tmp_path) == before


def test_a_wrong_identification_file_is_named(tmp_path: Path) -> None:
    file = tmp_path / "study.yaml"
    file.write_text("kind: nothing\n")
    done = run("identify", str(file), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert re.search(r"^Error: .*study\.yaml.*kind", done.stderr, re.MULTILINE)
    assert contents(tmp_path).keys() == {"study.yaml"}


def test_the_folder_is_looked_at_before_the_work(tmp_path: Path) -> None:
    file = tmp_path / "taken"
    file.write_text("mine")
    done = run(*THESIS, "--out", str(file / "deeper"))
    assert done.exit_code == 2
    assert f"--out {file / 'deeper'}: {file} is a file" in done.stderr
    assert file.read_text() == "mine"


def test_a_result_that_cannot_be_written_is_a_failure(tmp_path: Path) -> None:
    (tmp_path / "results.json").mkdir()
    done = run(*STEP, "--out", str(tmp_path))
    assert done.exit_code == 1
    assert re.search(r"^Error: .*results\.json", done.stderr, re.MULTILINE)


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    """Here a limit of the size of files, which names none either."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, hard))
    try:
        done = run("calibrate", "kang2007-inductive", "--order", "5", "--out", str(tmp_path))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert done.exit_code == 1
    assert f"Error: --out {tmp_path}: File too large" in done.stderr


@pytest.mark.parametrize("how", [["--traceback"], []])
def test_traceback_on_demand(how: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    if not how:
        monkeypatch.setenv("STICKSLIP_TRACEBACK", "1")
    done = run("simulate", *how)
    assert done.exit_code == 2
    assert "Traceback (most recent call last)" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("Error: --amplitude is missing")


@pytest.mark.parametrize(
    ("module", "arguments"),
    [("typer", ["--version"]), ("matplotlib", THESIS), ("jinja2", THESIS)],
)
def test_a_missing_extra_is_named(module: str, arguments: list[str], tmp_path: Path) -> None:
    program = (
        f"import sys, runpy; sys.modules[{module!r}] = None; "
        "runpy.run_module('stickslip', run_name='__main__', alter_sys=True)"
    )
    done = python(program, *arguments, cwd=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("Error: ")
    assert module in line
    assert 'pip install "stickslip[all]"' in line
    assert contents(tmp_path) == {}


def test_progress_in_plain_lines_and_the_command_on_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [*STEP, "--waveform", "sawtooth", "--frequency", "200 Hz", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", ["/somewhere/bin/stickslip", *arguments])
    lines = run(*arguments).stderr.splitlines()
    assert [line for line in lines if line.startswith("[")] == [
        "[  0%] simulating",
        "[ 60%] solving for the periodic motion",
        "[ 80%] writing",
    ]
    command = json.loads((tmp_path / "results.json").read_bytes())["command"]
    assert command.startswith("stickslip simulate kang2007 --waveform step --amplitude '65 V'")


def test_a_bar_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pty.openpty()
    with open(theirs, "w") as terminal, monkeypatch.context() as patched:
        patched.setattr(sys, "stderr", terminal)
        patched.setenv("TERM", "xterm")
        with progress_bar() as progress:
            progress("simulating", 0.25)
    seen = b""
    try:
        while part := os.read(ours, 4096):
            seen += part
    except OSError:  # how a terminal says that its other end has been closed
        pass
    os.close(ours)
    assert b"\x1b[" in seen
    assert b"simulating" in seen
    assert b" 25 %" in seen


def test_ctrl_c_while_it_is_imported_is_quiet() -> None:
    interrupted = (
        "import sys, importlib.abc, signal\n"
        "class Finder(importlib.abc.MetaPathFinder):\n"
        "    def find_spec(self, name, path, target=None):\n"
        "        if name == 'typer': signal.raise_signal(signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "from stickslip.__main__ import main\n"
        "main()"
    )
    done = python(interrupted)
    assert (done.returncode, done.stderr) == (130, "")


def test_runs_as_a_module() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "stickslip", "cite"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert done.stderr.startswith("Usage: stickslip cite")


def test_cite() -> None:
    assumed = "Assumed, for the source does not print it"
    for names, words in (
        (["kang2007"], ["@mastersthesis{kang2007", assumed, "end_effector_mass"]),
        (["LuGre"], ["@article{canudas1995"]),
        (["canudas1995", "pohl1987"], ["@article{canudas1995", "Parameter set pohl1987"]),
    ):
        done = run("cite", *names)
        assert done.exit_code == 0
        assert all(word in done.stdout for word in words)


@pytest.mark.filterwarnings("default")
def test_a_warning_is_one_line_and_among_the_assumptions(tmp_path: Path) -> None:
    """The samples of a drive do not show its jumps; that is no traceback and no line of source."""
    actuator = load_actuator("kang2007").replace(stage_reaction=False)
    walk = simulate(actuator, Sawtooth(65.0, 5.0, rise_fraction=0.998), 0.45, tolerance=1e-10)
    volts = walk["drive_voltage"].drop_attrs().assign_attrs(units="V")
    position = walk["end_effector_position"].drop_attrs().assign_attrs(units="m")
    channels = {"drive_voltage": volts, "end_effector_position": position}
    shown = make_recording(walk.time.values, {name: (x.values, x.units) for name, x in channels.items()})
    save_recording(shown, tmp_path / "walk.nc")
    file = (
        "kind: walk\ntitle: A walk\nmodel: kang2007\nchange: {stage_reaction: false}\n"
        "free: [sigma_0]\nstarts: 1\nrecordings: [{file: walk.nc}]\n"
    )
    (tmp_path / "walk.yaml").write_text(file, "utf-8")
    done = run("identify", str(tmp_path / "walk.yaml"), "--out", str(tmp_path / "out"))
    assert done.exit_code == 1, done.stderr  # what is found is wrong, and said to be
    said = [line for line in done.stderr.splitlines() if "drive_voltage" in line]
    assert [line.split(":")[0] for line in said] == ["Warning"]
    assert said[0].removeprefix("Warning: ") in html.unescape(
        (tmp_path / "out" / "report.html").read_text("utf-8")
    )


def test_a_warning_is_told_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A campaign fits one recording several times."""
    from stickslip.cli.frame import errors_in_one_line

    with errors_in_one_line(False):
        warnings.simplefilter("always")
        for text in ("too  fast", "too fast", "too slow"):
            warnings.warn(text, stacklevel=1)
    assert capsys.readouterr().err.splitlines() == ["Warning: too fast", "Warning: too slow"]


def test_a_new_folder_that_another_command_tries_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each looks whether it can write, and clears up after itself alone."""
    out, other = tmp_path / "a" / "out", tmp_path / "a" / "out" / ".room.1.part"
    synced = os.fsync

    def while_another_looks(number: int) -> None:
        other.touch()
        synced(number)

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", while_another_looks)
        check_output(out)
    assert contents(tmp_path).keys() == {"a/out/.room.1.part"}
    other.unlink()
    out.rmdir()
    made, gone = Path.mkdir, []

    def removed_at_once(folder: Path, *arguments, **how) -> None:
        made(folder, *arguments, **how)
        if folder == out and not gone:
            gone.append(folder)
            folder.rmdir()

    with monkeypatch.context() as patched:
        patched.setattr(Path, "mkdir", removed_at_once)
        check_output(out)
    assert gone
    assert [*tmp_path.rglob("*")] == [tmp_path / "a"]


def test_a_picture_goes_into_a_new_folder(tmp_path: Path) -> None:
    rows = [f"{k / 1e3},{k % 7}" for k in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(["t [s],x [um]", *rows]))
    done = run("inspect", str(tmp_path / "a.csv"), "--picture", str(tmp_path / "new" / "er" / "a.svg"))
    assert done.exit_code == 0, done.stderr
    assert (tmp_path / "new" / "er" / "a.svg").read_bytes().startswith(b"<svg")
    done = run("inspect", str(tmp_path / "a.csv"), "--picture", str(tmp_path / "a.csv" / "a.svg"))
    assert (done.exit_code, done.stdout) == (2, "")
    assert "a.csv is a file, not a folder" in done.stderr


def test_runs_are_compared_and_moved_all_or_none(tmp_path: Path) -> None:
    (tmp_path / "one.csv").write_text("t [s],x [m]\n0,0\n1,1\n")
    for wrong, words in (
        (["--compare", "one.csv"], "--compare one.csv: with what?"),
        (["--to-bin", "one.csv", "--to-bin", "two.csv"], "--to-bin two.csv: there is no such run in"),
        (["--to-bin", "one.csv", "--to-bin", "one.csv"], "--to-bin one.csv: it is named twice"),
    ):
        done = run("runs", str(tmp_path), *wrong)
        assert (done.exit_code, done.stdout) == (2, "")
        assert words in done.stderr
        assert (tmp_path / "one.csv").is_file()


@pytest.mark.parametrize(
    ("text", "encoding", "mark"),
    [
        ("title: Größe\n", "utf-16", "UTF-16"),
        ("title: Größe\n", "latin-1", ""),
        ("a: 1\n", "utf-16-le", "UTF-16"),
    ],
)
def test_a_file_in_another_encoding_is_said(text: str, encoding: str, mark: str, tmp_path: Path) -> None:
    (tmp_path / "job.yaml").write_bytes(text.encode(encoding))
    done = run("run", str(tmp_path / "job.yaml"), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert done.stderr.startswith(f"Error: {tmp_path}/job.yaml: ")
    assert mark in done.stderr
    assert "save it as UTF-8" in done.stderr
    assert "codec" not in done.stderr
