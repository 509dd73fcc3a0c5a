"""Faults at random instants of a run: does the output go to 0 V, and is what was recorded kept?

python -m benchmarks.faults [COUNT] [--seed S] [--workers N]

Each trial records from a rig as a lab has it: a program (a process), the process that owns the rig, and the
device, a third process. Drive, limits, fault and its instant are random. The program is killed, stalls or
freezes for good, has its disk full or its clock set back; so are the rig's process killed and frozen; the
sensor gives no number, freezes, jumps, drifts, has the wrong sign or a loose cable; samples come late; the
device's connection drops; a second operator comes, presses stop, or withdraws a permit. Half of the devices
stop by themselves when nobody talks to them; the others hold their last voltage, as an output card does.

It is judged by what an observer sees who knows nothing of the package: the amplifier's output, the true
position of the end-effector, what the program says last, and the History of its folder.
"""

from __future__ import annotations

import argparse
import json
import math
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
from benchmarks.fault_judge import (
    FAULTS,
    LOUD,
    SENSOR,
    UNREACHED,
    UNSEEN,
    WATCHDOG,
    Metronome,
    judge,
    kept,
    last_seen,
    watched,
)
from stickslip.quantities.registry import use_file
from stickslip.quantities.units import QuantityError
from stickslip.rig import HostedRig, Link, RigError, folder_of
from stickslip.rig.description import own_device
from stickslip.rig.experiment import run_experiment, running
from stickslip.rig.gate import PositionInput
from stickslip.rig.interlock import armed

FAR_RIG = Path(__file__).parent / "far_rig.py"


class Trial(NamedTuple):
    """What became of one.

    `late` is the time from the fault to 0 V less the stated ramp, s, None where the fault came when nothing
    was put out; `beyond` how far the end-effector was beyond its end stop, in steps; `held` is whether the
    output kept its voltage, and people were told; `wrong` what should not have been.
    """

    fault: str
    late: float | None
    finished: int
    unfinished: int
    wrong: list[str]
    holds: bool = False
    beyond: float = 0.0
    held: bool = False


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
    known = {"amplitude": amplitude, "frequency": fields["frequency"]}
    known["length"] = content["runs"][0]["capture"]["length"]
    return path, limits | known


def program(path: Path, out: Path, fault: str, random: random.Random, said: Path) -> int:
    """Record, in a process of its own; its number. What it says of an error is in a file."""
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
        home(yaml.safe_load(path.read_text())["rig"]["options"])
        with armed("a trial of the study"):
            run_experiment(path, out)
        code = 0
    except BaseException as error:
        said.write_text(". ".join((str(error), *getattr(error, "__notes__", ()))))
        raise
    finally:
        os._exit(code)


def home(options: dict[str, Any]) -> None:
    """Call where the end-effector is home: end stops count from there."""
    link = Link(rigs_of_port(options["port"]), "the study")
    with suppress(RigError, QuantityError):  # what the trial before left
        link.ask("permit", name="operators", given=True, who="the study", why="a new trial")
        link.ask("acknowledge", who="the study", why="a new trial")
    device = own_device(use_file(FAR_RIG).FarRig, options)
    HostedRig(link, device).home_here(PositionInput("ideal", ()), 1000.0)
    link.close()


def rigs_of_port(port: int | str) -> Path:
    """The folder of the process that owns the device at a port."""
    return folder_of(f"FarRig patience={WATCHDOG} port={port}")


def alive(child: int) -> bool:
    """Whether a program has not ended yet; it is not waited for."""
    return os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None


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
        if fault in ("program stalls", "program frozen", "rig's process stalls", "rig's process frozen"):
            process = child if fault.startswith("program") else number_of(rigs)
            now = time.monotonic()
            os.kill(process, signal.SIGSTOP)
            if fault.endswith("frozen"):
                return now
            time.sleep(max(WATCHDOG, OWN.watchdog) + random.uniform(0.4, 0.6))
            os.kill(process, signal.SIGCONT)
            return now
        if fault == "rig's process killed":
            process, now = number_of(rigs), time.monotonic()
            os.kill(process, signal.SIGKILL)
            return now
        if fault in ("second operator", "stop", "permit withdrawn"):
            other = Link(rigs, "a second operator")
            try:
                now = time.monotonic()
                if fault == "permit withdrawn":
                    other.ask("permit", name="operators", given=False, who="somebody", why="in the beam")
                    return now
                if fault == "stop":
                    return now if other.ask("stop", why="stop")[0]["stopped"] else None
                other.ask("open", device={"kind": "none"}, again=False)
            finally:
                other.close()
    return None


def trial(number: int, random: random.Random, folder: Path, port: str, holds: bool) -> Trial:
    """One run with one fault."""
    fault = FAULTS[number % len(FAULTS)]
    out, log, said = folder / f"out{number}", folder / "runs.jsonl", folder / "said"
    path, limits = experiment(random, port, folder)
    rigs = rigs_of_port(port)
    for one in (log, said, folder / "started", folder / "homed", folder / "watched.bin"):
        one.unlink(missing_ok=True)
    if fault in SENSOR:
        seconds = random.uniform(0.1, 2.5 * WATCHDOG)
        at = random.uniform(0.0, 0.6)
        (folder / "fault.json").write_text(json.dumps({"kind": fault, "at": at, "seconds": seconds}))
    child = program(path, out, fault, random, said)
    wrong: list[str] = []
    end = time.monotonic() + (100.0 if fault == "rig's process frozen" else 60.0)
    # At any time from before the rig is opened to after the last recording is saved; mostly in the first run.
    if random.random() < 0.75:
        while not (folder / "started").exists() and time.monotonic() < end - 20.0 and alive(child):
            time.sleep(0.002)
        time.sleep(random.uniform(0.0, limits["length"]))
    else:
        time.sleep(random.uniform(0.1, 2.0))
    with Metronome() as metronome:
        struck = strike(fault, child, rigs, random)
        _ended(child, fault, end, wrong)
    time.sleep(0.05)
    if fault == "rig's process frozen" and struck is not None:
        with suppress(OSError, ValueError, LookupError):
            os.kill(number_of(rigs), signal.SIGKILL)
    settled(rigs, wrong)
    held = switched_off(folder, wrong, end, holds and fault in UNREACHED)
    (folder / "fault.json").unlink(missing_ok=True)
    words = said.read_text() if said.exists() else ""
    if held and LOUD not in words:
        wrong.append(f"the output kept its voltage, and nobody was told: {words[:200]}")
    runs = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    late, more = judge(fault, struck, [] if held else runs, limits, holds, metronome.longest)
    beyond, seen = watched(folder, fault, limits, max(late or 0.0, 0.0))
    finished, unfinished, rest = kept(out, [] if held else runs, disk=fault != "disk full")
    if fault == "none" and not finished and not beyond:
        wrong.append(f"nothing was recorded, though nothing went wrong: {words[:200]}")
    return Trial(fault, late, finished, unfinished, wrong + more + seen + rest, holds, beyond, held)


def _ended(child: int, fault: str, end: float, wrong: list[str]) -> None:
    """Wait until a program has ended."""
    if fault == "program frozen":  # until somebody ends it
        time.sleep(WATCHDOG + 1.0)
        os.kill(child, signal.SIGKILL)
    while os.waitpid(child, os.WNOHANG)[0] == 0:
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            wrong.append("the program did not end")
            return
        time.sleep(0.005)


def switched_off(folder: Path, wrong: list[str], end: float, may_hold: bool) -> bool:
    """Wait for 0 V. Where the device may hold its voltage, a person switches it off in the end; whether that
    was needed."""
    while (folder / "running").exists() or abs(last_seen(folder)) > 0.1:
        if may_hold and time.monotonic() > end - 20.0:
            (folder / "off").touch()
            while (folder / "off").exists() and time.monotonic() < end:
                time.sleep(0.005)
            return True
        if time.monotonic() > end:
            wrong.append(f"the output stays at {last_seen(folder):.1f} V")
            (folder / "off").touch()
            return False
        time.sleep(0.005)
    return False


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


@contextmanager
def device(folder: Path, holds: bool) -> Iterator[str]:
    """The device's process; gives its port."""
    (folder / "port").unlink(missing_ok=True)
    command = [sys.executable, "-m", "benchmarks.fault_device", str(folder), *(["holds"] if holds else [])]
    process = subprocess.Popen(command, start_new_session=True)
    try:
        while not (folder / "port").exists() or not (folder / "port").read_text():
            assert process.poll() is None
            time.sleep(0.05)
        yield (folder / "port").read_text()
    finally:
        process.kill()
        process.wait()


def work(numbers: list[int], seed: int, folder: Path, tell: Any, end: float) -> None:
    """The trials of one worker, on devices of its own; none begins after `end`."""
    for one in ("stops", "holds"):
        (folder / one).mkdir(parents=True)
    os.environ["STICKSLIP_RIGS"] = str(folder / "rigs")
    with device(folder / "stops", False) as port, device(folder / "holds", True) as other:
        for number in numbers:
            if time.monotonic() > end:
                break
            holds = number // len(FAULTS) % 2 == 1
            where = folder / ("holds" if holds else "stops")
            chance = random.Random(f"{seed} {number}")
            tell.put(trial(number, chance, where, other if holds else port, holds))
    tell.put(None)


def study(count: int, seed: int, workers: int = 1, minutes: float = math.inf) -> list[Trial]:
    """So many trials, or as many as begin within some minutes; the faults take turns."""
    end = time.monotonic() + 60.0 * minutes
    context = multiprocessing.get_context("fork")
    found: list[Trial] = []
    with tempfile.TemporaryDirectory(prefix="stickslip-faults-", ignore_cleanup_errors=True) as folder:
        tell = context.Queue()
        numbers = [list(range(count))[i::workers] for i in range(workers)]
        processes = [
            context.Process(target=work, args=(numbers[i], seed, Path(folder) / str(i), tell, end))
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
                    kind = "holds" if came.holds else "stops"
                    print(f"{came.fault}, {kind}: {'; '.join(came.wrong)}", file=sys.stderr, flush=True)
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
    parser.add_argument("--minutes", type=float, default=math.inf)
    asked = parser.parse_args()
    found = study(asked.count, asked.seed, asked.workers, asked.minutes)
    print(
        "| fault | trials | hit an output | ramp after, median | at most | held, people told | "
        "beyond an end stop, most | finished | unfinished | wrong |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for fault in FAULTS:
        here = [one for one in found if one.fault == fault]
        late = sorted(one.late for one in here if one.late is not None)
        times = f"{1e3 * late[len(late) // 2]:.0f} ms | {1e3 * late[-1]:.0f} ms" if late else "- | -"
        whole, rest = sum(one.finished for one in here), sum(one.unfinished for one in here)
        wrong = sum(bool(one.wrong) for one in here)
        held, beyond = sum(one.held for one in here), max((one.beyond for one in here), default=0.0)
        kept_ones = f"{whole} | {rest} | {wrong} |"
        print(f"| {fault} | {len(here)} | {len(late)} | {times} | {held} | {beyond:.2f} steps | {kept_ones}")
    seen = [one.beyond for one in found if one.fault not in UNSEEN and one.beyond > 0.0]
    if seen:
        print(
            f"\nBeyond an end stop: {len(seen)}, {sum(one <= 1.0 for one in seen)} of them within one step."
        )
    wrong = Counter(bool(one.wrong) for one in found)[True]
    print(f"\n{len(found)} faults, seed {asked.seed}: {wrong} with anything wrong.")
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main())
