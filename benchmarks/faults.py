"""Faults at random instants of a run: does the output go to 0 V, and is what was recorded kept?

python -m benchmarks.faults [COUNT] [--seed S] [--workers N]

Each trial records from a rig as a lab has it: a program (a process), the process that owns the rig, and the
device, a third process with an amplifier whose output is written down. Drive, limits, fault and its instant
are random. The program is killed, stalls, has its disk full or its clock set back; the rig's process is
killed or stalls; the sensor gives NaN, freezes, jumps; samples come late; the device's connection drops; a
second operator comes, or presses stop.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from benchmarks.fault_device import OWN
from stickslip.quantities.registry import use_file
from stickslip.recording import open_recording
from stickslip.rig import Link, RigError, folder_of
from stickslip.rig.experiment import run_experiment, running
from stickslip.rig.samples import recover

FAR_RIG = Path(__file__).parent / "far_rig.py"
WATCHDOG = 0.4  # s
BLOCK = 0.02  # s in which a fault is seen
GRACE = 0.25  # s for the processes of a machine that does other things besides
FAULTS = (
    "program killed", "program stalls", "rig's process killed", "rig's process stalls", "nan", "frozen",
    "jump", "late", "gone", "disk full", "clock set back", "second operator", "stop", "none",
)  # fmt: skip
# What has to pass until somebody notices, s, besides a block.
NOTICED = {
    "program stalls": WATCHDOG,
    "rig's process stalls": OWN.watchdog,
    "rig's process killed": 0.0,
    "frozen": 0.1,
    "late": WATCHDOG + 1.0,  # a connection that says nothing so long is closed
}


class Trial(NamedTuple):
    """What became of one: `late` is the time from the fault to 0 V less the stated ramp, s, None where the
    fault came when nothing was put out; `wrong` what should not have been."""

    fault: str
    late: float | None
    finished: int
    unfinished: int
    wrong: list[str]


def experiment(random: random.Random, port: str, folder: Path) -> tuple[Path, dict[str, Any]]:
    """A random experiment file, and its limits."""
    limits = {
        "max_voltage": random.uniform(40.0, 120.0),
        "max_slew": 4e6,
        "stop_slew": random.uniform(300.0, 5000.0),
        "watchdog": WATCHDOG,
        "max_position": random.uniform(20e-6, 200e-6),
        "min_position": -200e-6,
    }
    shape = random.choice(["Sawtooth", "Triangle", "Sine"])
    amplitude = random.uniform(0.3, 0.99) * limits["max_voltage"]
    fields = {"amplitude": amplitude, "frequency": random.uniform(5.0, 40.0)}
    if shape == "Sine":
        fields |= {"amplitude": amplitude / 2, "offset": amplitude / 2}
    content = {
        "title": "Fault",
        "rig": {"kind": f"{FAR_RIG}:FarRig", "options": {"port": int(port), "patience": WATCHDOG}},
        "limits": limits,
        "channels": {"drive_voltage": {"input": "drive"}, "end_effector_position": {"input": "ideal"}},
        "runs": [
            {
                "name": "walk",
                "repeats": 2,
                "waveform": [{"shape": shape, "fields": fields}],
                "capture": {"length": random.uniform(0.25, 0.6), "interval": 1e-3, "pre_trigger": 0.02},
            }
        ],
    }
    path = folder / "experiment.yaml"
    path.write_text(yaml.safe_dump(content))
    return path, limits


def program(path: Path, out: Path, fault: str, random: random.Random) -> int:
    """Record, in a process of its own; its number."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 2)
        if fault == "disk full":
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            most = int(10 ** random.uniform(4.5, 6.0))
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
        if fault == "clock set back":
            began = time.monotonic() + random.uniform(0.0, 1.0)
            back = timedelta(seconds=random.uniform(1.0, 1e6))

            class Clock(datetime):
                @classmethod
                def now(cls, tz: Any = None) -> datetime:
                    return datetime.now(tz or UTC) - (back if time.monotonic() > began else timedelta())

            running.datetime = Clock  # type: ignore[misc]
        use_file(FAR_RIG)
        run_experiment(path, out)
        code = 0
    finally:
        os._exit(code)


def number_of(rigs: Path) -> int:
    """Of the process that owns the rig."""
    return int(json.loads((rigs / "rig.json").read_text())["pid"])


def strike(fault: str, child: int, rigs: Path, random: random.Random) -> float | None:
    """Do it; when, s of the monotonic clock."""
    with suppress(OSError, ValueError, LookupError, RigError):
        if fault == "program killed":
            now = time.monotonic()
            os.kill(child, signal.SIGKILL)
            return now
        if fault.endswith("stalls"):
            process = child if fault.startswith("program") else number_of(rigs)
            now = time.monotonic()
            os.kill(process, signal.SIGSTOP)
            time.sleep(max(WATCHDOG, OWN.watchdog) + random.uniform(0.4, 0.6))
            os.kill(process, signal.SIGCONT)
            return now
        if fault == "rig's process killed":
            process, now = number_of(rigs), time.monotonic()
            os.kill(process, signal.SIGKILL)
            return now
        if fault in ("second operator", "stop"):
            other = Link(rigs, "a second operator")
            try:
                now = time.monotonic()
                if fault == "stop":
                    return now if other.ask("stop", why="stop")[0]["stopped"] else None
                other.ask("open", device={"kind": "none"}, again=False)
            finally:
                other.close()
    return None


def judge(
    fault: str, struck: float | None, runs: list[dict[str, Any]], limits: dict[str, Any]
) -> tuple[float | None, list[str]]:
    """How late 0 V came, and what was wrong with the output."""
    wrong, late = [], None
    for one in runs:
        half = 0.5 * one["step"] + 1e-6
        if one["greatest"] > limits["max_voltage"] + half or one["least"] < -half:
            wrong.append(f"the output went from {one['least']:.3f} to {one['greatest']:.3f} V")
        if one["slew"] > limits["max_slew"] + one["step"] * 20e3:
            wrong.append(f"the output changed at {one['slew']:.3g} V/s")
        if abs(one["end"]) > one["step"]:
            wrong.append(f"the output ended at {one['end']:.3f} V")
        stated = abs(one["volts"]) / min(limits["stop_slew"], OWN.stop_slew) + 2e-3
        if one["ramp"] > stated + one["step"] / limits["stop_slew"]:
            wrong.append(f"the ramp from {one['volts']:.2f} V took {one['ramp']:.4f} s")
        began = one["failed"] if fault in ("nan", "frozen", "jump", "late", "gone") else struck
        if began is not None and one["began"] <= began <= one["stopped"]:
            late = one["stopped"] - began
            if late > NOTICED.get(fault, 0.0) + 2 * BLOCK + GRACE:
                wrong.append(f"the ramp began {late:.3f} s after the fault")
    return late, wrong


def trial(number: int, random: random.Random, folder: Path, port: str) -> Trial:
    """One run with one fault."""
    fault = FAULTS[number % len(FAULTS)]
    out, log = folder / f"out{number}", folder / "runs.jsonl"
    path, limits = experiment(random, port, folder)
    rigs = folder_of(f"FarRig patience={WATCHDOG} port={port}")
    (rigs / "home.json").unlink(missing_ok=True)
    log.unlink(missing_ok=True)
    (folder / "started").unlink(missing_ok=True)
    if fault in ("nan", "frozen", "jump", "late", "gone"):
        seconds = random.uniform(0.1, 2.5 * WATCHDOG)
        at = random.uniform(0.0, 0.6)
        (folder / "fault.json").write_text(json.dumps({"kind": fault, "at": at, "seconds": seconds}))
    child = program(path, out, fault, random)
    wrong: list[str] = []
    end = time.monotonic() + 30.0
    # At any time from before the rig is opened to after the last recording is saved; mostly in the first run.
    if random.random() < 0.75:
        while not (folder / "started").exists() and time.monotonic() < end - 20.0:
            time.sleep(0.002)
        time.sleep(random.uniform(0.0, 0.6))
    else:
        time.sleep(random.uniform(0.1, 2.0))
    struck = strike(fault, child, rigs, random)
    while os.waitpid(child, os.WNOHANG)[0] == 0:
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            wrong.append("the program did not end")
        time.sleep(0.005)
    time.sleep(0.05)
    settled(rigs, wrong)
    while (folder / "running").exists():  # a device that is late is so after the others have given it up
        if time.monotonic() > end:
            wrong.append("the device goes on")
            break
        time.sleep(0.005)
    (folder / "fault.json").unlink(missing_ok=True)
    runs = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    late, said = judge(fault, struck, runs, limits)
    finished, unfinished, more = kept(out, runs, disk=fault != "disk full")
    return Trial(fault, late, finished, unfinished, wrong + said + more)


def settled(rigs: Path, wrong: list[str]) -> None:
    """Wait until nothing runs, as the rig's process says; or another one, if that was killed."""
    try:
        link = Link(rigs, "the study")
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            state = link.ask("state")[0]
            if state["phase"] == "idle" and not state["holder"]:
                break
            time.sleep(0.01)
        if time.monotonic() > end:
            wrong.append("the run goes on")
        link.close()
    except RigError as error:
        wrong.append(str(error))


def kept(out: Path, runs: list[dict[str, Any]], disk: bool) -> tuple[int, int, list[str]]:
    """Recordings that are whole, those that are not and are listed, and what is wrong with either."""
    wrong = []
    if not out.exists():
        return 0, 0, ["runs without a folder"] if any(one["fetched"] > 0 for one in runs) else []
    recover(out)
    whole, rest = list(out.glob("*.nc")), list(out.glob("unfinished/*.nc"))
    for path in (*whole, *rest):
        outcome = open_recording(path).attrs["outcome"]
        if (outcome == "complete") != (path in whole):
            wrong.append(f"{path.name}: {outcome}")
    # Two blocks on their way may be lost, and the first 10 ms are for filters to settle.
    begun = sum(one["fetched"] > 0.1 for one in runs)
    if disk and begun > len(whole) + len(rest):
        wrong.append(f"{begun} runs, {len(whole)} recordings and {len(rest)} unfinished ones")
    if list(out.glob(".*.samples")) and disk:
        wrong.append("samples are left that belong to nothing")
    return len(whole), len(rest), wrong


@contextmanager
def device(folder: Path) -> Iterator[str]:
    """The device's process; gives its port."""
    (folder / "port").unlink(missing_ok=True)
    process = subprocess.Popen([sys.executable, "-m", "benchmarks.fault_device", str(folder)])
    try:
        while not (folder / "port").exists() or not (folder / "port").read_text():
            assert process.poll() is None
            time.sleep(0.05)
        yield (folder / "port").read_text()
    finally:
        process.kill()
        process.wait()


def work(numbers: list[int], seed: int, folder: Path, tell: Any) -> None:
    """The trials of one worker, on a device of its own."""
    folder.mkdir()
    os.environ["STICKSLIP_RIGS"] = str(folder / "rigs")
    with device(folder) as port:
        for number in numbers:
            tell.put(trial(number, random.Random(f"{seed} {number}"), folder, port))
    tell.put(None)


def study(count: int, seed: int, workers: int = 1) -> list[Trial]:
    """So many trials; the faults take turns."""
    context = multiprocessing.get_context("fork")
    found: list[Trial] = []
    with tempfile.TemporaryDirectory(prefix="stickslip-faults-", ignore_cleanup_errors=True) as folder:
        tell = context.Queue()
        numbers = [list(range(count))[i::workers] for i in range(workers)]
        processes = [
            context.Process(target=work, args=(numbers[i], seed, Path(folder) / str(i), tell))
            for i in range(workers)
        ]
        for one in processes:
            one.start()
        left = workers
        while left:
            came = tell.get(timeout=120.0)
            left -= came is None
            if came is not None:
                found.append(came)
                if came.wrong:
                    print(f"{came.fault}: {'; '.join(came.wrong)}", file=sys.stderr, flush=True)
        for one in processes:
            one.join()
    return found


def main() -> int:
    """Run it, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    found = study(asked.count, asked.seed, asked.workers)
    print("| fault | trials | hit an output | ramp after, median | at most | finished | unfinished | wrong |")
    print("|---|---|---|---|---|---|---|---|")
    for fault in FAULTS:
        here = [one for one in found if one.fault == fault]
        late = sorted(one.late for one in here if one.late is not None)
        times = f"{1e3 * late[len(late) // 2]:.0f} ms | {1e3 * late[-1]:.0f} ms" if late else "- | -"
        whole, rest = sum(one.finished for one in here), sum(one.unfinished for one in here)
        wrong = sum(bool(one.wrong) for one in here)
        print(f"| {fault} | {len(here)} | {len(late)} | {times} | {whole} | {rest} | {wrong} |")
    wrong = Counter(bool(one.wrong) for one in found)[True]
    print(f"\n{len(found)} faults, seed {asked.seed}: {wrong} with anything wrong.")
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
