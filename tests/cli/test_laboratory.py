"""Commands of the laboratory."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml
from typer.testing import CliRunner

from stickslip.cli import app
from stickslip.recording.calibration import load_calibration, read_table


def run(*arguments: str):
    return CliRunner().invoke(app, [*arguments], prog_name="stickslip")


def test_calibrate(tmp_path: Path) -> None:
    done = run("calibrate", "kang2007-inductive", "--order", "5", "--out", str(tmp_path))
    assert done.exit_code == 0, done.stderr
    made = load_calibration(tmp_path / "calibration.json")
    np.testing.assert_allclose(made.coefficients, load_calibration("kang2007-inductive-5").coefficients)
    numbers = json.loads((tmp_path / "results.json").read_text())["numbers"]
    assert numbers["max_error"] == {"value": pytest.approx(5.4e-6, abs=0.1e-6), "unit": "m"}
    assert numbers["coefficients"]["c_2"]["unit"] == "m/V^2"
    assert numbers["coefficients"]["c_2"]["standard_error"] == pytest.approx(3.0e-6, rel=0.01)
    assert "kang2007" in (tmp_path / "report.html").read_text()


def test_calibrate_chooses_the_order_and_corrects_another_calibration(tmp_path: Path) -> None:
    """A caliper says 2 % more than the maker's polynomial: order 1 is found, with the slope 1.02."""
    first = load_calibration("kang2007-inductive-5")
    volts = np.linspace(0.5, 9.5, 12)
    true = 1.02e3 * first(volts) + 0.01 + 1e-5 * np.random.default_rng(0).standard_normal(12)
    rows = "\n".join(f"{y:.9f},{v:.9f}" for y, v in zip(true, volts, strict=True))
    path = tmp_path / "caliper.csv"
    path.write_text(f"caliper [mm],sensor [V]\n{rows}\n")
    out = tmp_path / "out"
    done = run("calibrate", str(path), "--after", "kang2007-inductive-5", "--out", str(out))
    assert done.exit_code == 0, done.stderr
    made = load_calibration(out / "calibration.json")
    assert (made.name, made.x_unit, made.y_unit) == ("caliper-1", "m", "m")
    np.testing.assert_allclose(made.coefficients, [1e-5, 1.02], rtol=1e-3)


def test_calibrate_refuses_in_one_line(tmp_path: Path) -> None:
    for arguments, message in (
        (["gone.csv"], "gone.csv"),
        (["kang2007-inductive", "--order", "five"], "--order five"),
        (["kang2007-inductive", "--order", "15"], "too few"),
        (["kang2007-inductive", "--after", "nobody"], "nobody"),
        (["kang2007-inductive", "--after", "kang2007-recalibration"], "takes m"),
    ):
        done = run("calibrate", *arguments, "--out", str(tmp_path / "out"))
        assert done.exit_code == 2
        assert message in done.stderr
        assert done.stderr.count("\n") == 1
        assert not (tmp_path / "out").exists()
    assert read_table("kang2007-inductive").x_unit == "V"


def small(folder: Path, **changes: object) -> Path:
    run_ = {
        "name": "walk",
        "matrix": {"voltage": ["35 V", "65 V"]},
        "waveform": [{"shape": "Sawtooth", "fields": {"amplitude": "$voltage", "frequency": 20}}],
        "capture": {"length": 0.1, "interval": 1e-3, "pre_trigger": 0.01},
    }
    content = {
        "title": "Two walks",
        "rig": {"kind": "virtual"},
        "channels": {"drive_voltage": {"input": "drive"}, "end_effector_position": {"input": "ideal"}},
        "runs": [run_],
        **changes,
    }
    path = folder / "experiment.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def test_record(tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("record", str(small(tmp_path)), "--out", str(out))
    assert done.exit_code == 0, done.stderr
    assert "[  0%] checking" in done.stderr
    assert "walk_65V" in done.stderr
    assert {p.name for p in out.iterdir()} >= {"walk_35V.nc", "walk_65V.nc", "experiment.log", "report.html"}
    numbers = json.loads((out / "results.json").read_text())["numbers"]
    assert numbers["walk_65V"]["drive_voltage"]["value"] == pytest.approx(64.0, abs=1.0)
    page = (out / "report.html").read_text()
    assert "sensor.inductive.noise_density" in page  # what is assumed of the bench
    again = run("record", str(small(tmp_path)), "--out", str(out))
    assert "2 of them were there already" in again.stdout


def test_record_interrupted(tmp_path: Path) -> None:
    """In real time it would take three minutes: whichever signal ends it, what was recorded is kept."""
    long = {"length": 180.0, "interval": 1e-3, "pre_trigger": 0.01}
    content = yaml.safe_load(small(tmp_path).read_text())
    content["runs"].append({**content["runs"][0], "name": "long", "capture": long})
    path, out = (
        small(tmp_path, runs=content["runs"], rig={"kind": "virtual", "real_time": True}),
        tmp_path / "out",
    )
    command = [sys.executable, "-m", "stickslip", "record", str(path), "--out", str(out)]
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        with (
            subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
            contextlib.ExitStack() as at_last,
        ):
            at_last.callback(process.kill)  # a test that fails must not wait for ever
            assert process.stderr is not None
            while "long_35V" not in (line := process.stderr.readline()):
                assert line, "it ended early"
            process.send_signal(sign)
            rest = process.communicate(timeout=300)[1]
        assert process.returncode == 130, rest
        said = "Error: interrupted; what was finished is kept, and the same command continues"
        assert rest.strip().splitlines()[-1] == said
    assert {p.stem for p in out.glob("*.nc")} == {"walk_35V", "walk_65V"}
    assert (out / "experiment.log").read_text().count("stopped: KeyboardInterrupt") == 3


def test_a_closed_terminal_ends_a_recording_as_ctrl_c_does(tmp_path: Path) -> None:
    long = {"length": 20.0, "interval": 1e-3, "pre_trigger": 0.01}
    content = yaml.safe_load(small(tmp_path).read_text())
    content["runs"] = [{**content["runs"][0], "name": "long", "capture": long}]
    path = small(tmp_path, runs=content["runs"], rig={"kind": "virtual", "real_time": True})
    out = tmp_path / "out"
    process, terminal = pty.fork()
    if not process:  # the child, whose terminal it is
        os.execv(sys.executable, [sys.executable, "-m", "stickslip", "record", str(path), "--out", str(out)])
    try:
        end = time.monotonic() + 300.0
        while not any(int.from_bytes(one.read_bytes()[:8], "little") for one in out.glob(".long_*.samples")):
            assert time.monotonic() < end
            if select.select([terminal], [], [], 0.05)[0]:
                os.read(terminal, 10_000)
    finally:
        os.close(terminal)
        ended = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert ended == 130
    listed = run("runs", str(out))
    assert "unfinished/long_35V.nc" in listed.stdout
    assert not list(out.glob(".*.samples"))


def test_record_refuses_in_one_line(tmp_path: Path) -> None:
    done = run("record", str(small(tmp_path, limits={"max_voltage": "50 V"})), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert (
        f"Error: {tmp_path}/experiment.yaml: run 'walk', voltage = 65 V: the drive reaches 6" in done.stderr
    )
    done = run("record", str(small(tmp_path, runs=[])), "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert "experiment.yaml: runs:" in done.stderr


def test_the_demonstration_interrupted(tmp_path: Path) -> None:
    """Ctrl-C in a terminal reaches its other processes too: they say nothing, and end."""
    command = [sys.executable, "-m", "stickslip", "demo", "--out", str(tmp_path / "out")]
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process,
        contextlib.ExitStack() as at_last,
    ):
        at_last.callback(process.kill)
        assert process.stderr is not None
        while "step_60V" not in (line := process.stderr.readline()):
            assert line, "it ended early"
        others = psutil.Process(process.pid).children()
        os.killpg(process.pid, signal.SIGINT)
        rest = process.communicate(timeout=300)[1]
    assert process.returncode == 130
    assert "Traceback" not in rest
    assert rest.strip().splitlines()[-1].startswith("Error: interrupted; finished recordings and stages")
    assert len(others) >= 2
    assert not psutil.wait_procs(others, timeout=60.0)[1]


def test_schema() -> None:
    fields = {"job": "steps", "experiment": "channels", "campaign": "hops", "identification": "recordings"}
    for kind, field in fields.items():
        assert field in json.dumps(json.loads(run("schema", kind).stdout))


def test_a_twin_on_a_pseudo_terminal() -> None:
    command = [sys.executable, "-m", "stickslip", "twin", "kim101", "--pty"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        where = process.stdout.readline().strip()
        port = os.open(where, os.O_RDWR | os.O_NOCTTY)
        os.write(port, bytes([0x05, 0x00, 0, 0, 0x50, 0x01]))  # who is there?
        assert b"KIM101" in os.read(port, 90)
        os.close(port)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300)
    assert process.returncode == 130
    for name in ("nv200", "scpi"):
        said = CliRunner().invoke(app, ["twin", name, "--pty", "--axes", "1"])
        assert said.exit_code == 2
        assert "has no serial port" in said.output


def test_a_twin_of_a_pair_of_instruments() -> None:
    command = [sys.executable, "-m", "stickslip", "twin", "scpi"]
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with (
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        ) as process,
        contextlib.ExitStack() as at_last,
    ):
        at_last.callback(process.kill)
        assert process.stdout is not None
        for role, model in (("generator", b"33522B"), ("oscilloscope", b"DSO-X 3024A")):
            said, where = process.stdout.readline().split()
            address, _, port = where.partition(":")
            assert (said, address) == (role, "127.0.0.1")
            with socket.create_connection((address, int(port)), timeout=60.0) as link:
                link.sendall(b"*IDN?\n")
                assert model in link.recv(100)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300)
    assert process.returncode == 130


RECORD = [sys.executable, "-m", "stickslip", "record"]


# Waits where the report writes a file, until it is interrupted, and says by a file of its own that it waits.
WAITING = """
import sys, time
from pathlib import Path


def wait(event, given):
    if event == "open" and {name!r} in str(given[0]):
        Path({there!r}).touch()
        while True:
            time.sleep(0.01)


sys.addaudithook(wait)
"""


@pytest.mark.parametrize("name", [".results.json.", "together.svg", "detail.svg", ".report.html."])
def test_an_interruption_in_the_report_is_not_lost(tmp_path: Path, name: str) -> None:
    out, there = tmp_path / "out", tmp_path / "there"
    (tmp_path / "own.py").write_text(WAITING.format(name=name, there=str(there)))
    command = [sys.executable, "-m", "stickslip", "--use", str(tmp_path / "own.py"), "record"]
    with (
        subprocess.Popen(
            [*command, str(small(tmp_path)), "--out", str(out)], stderr=subprocess.PIPE, text=True
        ) as process,
        contextlib.ExitStack() as at_last,
    ):
        at_last.callback(process.kill)
        end = time.monotonic() + 300.0
        while not there.exists():
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=300)[1]
    assert process.returncode == 130, said
    assert "interrupted; what was finished is kept" in said
    assert {path.stem for path in out.glob("*.nc")} == {"walk_35V", "walk_65V"}


def samples_kept(out: Path) -> bool:
    """Whether samples are on the disk; the folder itself comes and goes while it is tried."""
    with contextlib.suppress(FileNotFoundError):
        return any(int.from_bytes(one.read_bytes()[:8], "little") for one in out.glob(".walk*.samples"))
    return False


RIG = """
from pathlib import Path

from stickslip import load_actuator, registry
from stickslip.rig import VirtualRig, load_bench


@registry.rigs.add
class Mine(VirtualRig):
    def __init__(self, log):
        super().__init__(load_actuator("kang2007"), load_bench("kang2007-bench"), real_time=True)
        self.log = Path(log)

    def stop(self, slew):
        super().stop(slew)
        self.log.write_text(str(self.output()[1][-1]))
"""


def test_a_second_interruption_ends_at_once_with_the_output_at_zero(tmp_path: Path) -> None:
    """The rig is in a process of its own, and tells what was put out last."""
    environment = {**os.environ, "STICKSLIP_RIGS": str(tmp_path / "rigs")}
    (tmp_path / "my_rig.py").write_text(RIG)
    log, out = tmp_path / "stopped", tmp_path / "out"
    content = yaml.safe_load(small(tmp_path).read_text())
    content["runs"][0]["capture"] = {"length": 30.0, "interval": 1e-3, "pre_trigger": 0.01}
    rig = {"kind": "my_rig.py:Mine", "options": {"log": str(log)}}
    path = small(tmp_path, runs=content["runs"], rig=rig)
    with (
        subprocess.Popen(
            [*RECORD, str(path), "--out", str(out)], stderr=subprocess.PIPE, text=True, env=environment
        ) as process,
        contextlib.ExitStack() as at_last,
    ):
        at_last.callback(process.kill)
        end = time.monotonic() + 300.0
        while not samples_kept(out):
            assert time.monotonic() < end
            time.sleep(0.01)
        log.unlink(missing_ok=True)  # of the opening
        # Both at once: the first has no time to be heard in the run.
        process.send_signal(signal.SIGINT)
        time.sleep(0.001)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=300)
        assert process.returncode == 130
    assert abs(float(log.read_text())) < 0.1
    samples = out / "unfinished"
    assert not samples.exists() or list(samples.iterdir())


def test_ctrl_c_in_a_text_that_a_library_executes_is_exit_code_130(tmp_path: Path) -> None:
    """As dataclasses and Numba do; Python itself would end by the signal then, though it was caught."""
    (tmp_path / "own.py").write_text('exec("import signal; signal.raise_signal(signal.SIGINT)")\n')
    command = [sys.executable, "-m", "stickslip", "--use", str(tmp_path / "own.py"), "list"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 130
    assert done.stderr == "Error: interrupted; nothing is kept\n"


def test_an_address_that_cannot_be_asked() -> None:
    for at, words, code in (
        ("127.0.0.1:abc", "--at 127.0.0.1:abc: 'abc' is no port", 2),
        ("127.0.0.1:70000", "'70000' is no port", 2),
        ("nowhere.invalid", "--at nowhere.invalid: there is no host 'nowhere.invalid'", 2),
        ("127.0.0.1:PORT", "127.0.0.1:PORT: no controller that is known answers there", 1),
    ):
        with socket.socket() as free:  # bound, and nobody listens
            free.bind(("127.0.0.1", 0))
            port = str(free.getsockname()[1])
            done = run("rigs", "--at", at.replace("PORT", port))
        assert done.exit_code == code
        assert words.replace("PORT", port) in done.stderr
