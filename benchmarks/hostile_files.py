"""python -m benchmarks.hostile_files [--page]: what it costs to open hostile files, and what is said.

Each file is opened from Python, by the command line and by a panel that serves a folder: time by the clock
and of computing, peak memory of each process, and the sentence. Kernels that a panel compiles at its first
start are compiled before. `--page` writes docs/benchmarks/hostile-files.md.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import h5py
import httpx
import numpy as np
from tests.gate.hostile import MAKERS
from tests.gate.test_hdf5 import OUTSIDE, made
from tests.gate.test_structure import READ
from tests.gate.test_text import JSON, TOML, YAML

from .hostile_programs import COMMANDED, Programs, Run
from .results import write_page

SECONDS, MEGABYTES = 10.0, 500.0  # of computing and of memory that one process may take to open one file
PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks" / "hostile-files.md"
BOMB = 200_000_000  # bytes that a file of some 100 kB unpacks to
PYTHON = {  # what opens a file of each kind from Python, and its documented error
    "data": "import stickslip as ss; act, E = ss.read_recording, ss.recording.RecordingError",
    "yaml": "from stickslip.jobs.file import read_job as act, InputFileError as E",
    "toml": "from stickslip.parameters import load_set as act, ParameterSetError as E",
    "json": "from stickslip.identify.saved import FitError as E, load_fit as act",
}
COMMAND = {"data": "inspect", "yaml": "run", "toml": "cite", "json": "verify"}
OTHERS = ("record", "campaign", "identify", "design")  # that take YAML too; each is tried with some files
CALLED = """
import sys, warnings
from pathlib import Path
warnings.simplefilter("ignore")
{}
try:
    act(Path({!r}))
except E as error:
    sys.exit(str(error))
"""


class Case(NamedTuple):
    """A hostile file: its kind, its name, and who makes it."""

    kind: str
    name: str
    make: Callable[[Path], object]


class Cost(NamedTuple):
    """Cost of opening a file [s, s, MB], the exit code or status, what was said, and whether that is right: a
    refusal or, for files of `LET_IN`, an answer."""

    way: str
    name: str
    wall: float
    cpu: float
    megabytes: float
    code: int
    said: str
    right: bool


def cases() -> Iterator[Case]:
    """All hostile files."""
    for name, make in MAKERS.items():
        yield Case("data", name, make)
    for fill in OUTSIDE:
        for ending in ("mat", "nc"):
            name = f"{fill.__name__}.{ending}"
            yield Case("data", name, lambda path, fill=fill: made(path.parent, fill, path.name))
    for make in (zip_bomb, hdf5_bomb, matlab_bomb, large_bomb):
        yield Case("data", f"{make.__name__}.{ENDINGS[make.__name__]}", make)
    texts = {"yaml": YAML | LARGEST["yaml"], "toml": TOML, "json": JSON | LARGEST["json"]}
    for kind, group in texts.items():
        for name, (text, _) in group.items():
            called = f"{name.replace(' ', '_')}.{kind}"
            yield Case(kind, called, lambda path, text=text: path.write_text(text))
    yield Case("json", "gzip_bomb.json", lambda path: path.write_bytes(gzip.compress(b" " * BOMB)))


# The largest that pass the limits of text.
LARGEST = {
    "yaml": {
        "largest_list": ("x: [" + "1, " * 90_000 + "]", ""),
        "largest_text": ("x: '" + "y" * 990_000 + "'", ""),
        "largest_mapping": ("runs:\n" + "".join(f"  - {{a: {n}}}\n" for n in range(30_000)), ""),
    },
    "json": {"largest": ("[" + ", ".join(['{"a": 1}'] * 499_000) + "]", "")},
}
# Files that are read: the largest within the limits, and those of which what is unusual costs little.
LET_IN = READ | {f"{name}.{kind}" for kind, group in LARGEST.items() for name in group}
ENDINGS = {"zip_bomb": "npz", "hdf5_bomb": "nc", "matlab_bomb": "mat", "large_bomb": "npz"}


def zip_bomb(path: Path) -> None:
    """Zeros in a packed archive."""
    np.savez_compressed(path, time=np.zeros(BOMB // 8))


def hdf5_bomb(path: Path) -> None:
    """Zeros in packed parts."""
    with h5py.File(path, "w") as file:
        file.create_dataset("time", (BOMB // 8,), "f8", chunks=(2**20,), compression="gzip")[...] = 0.0


def matlab_bomb(path: Path) -> None:
    """Zeros in one packed variable."""
    content = zlib.compress(bytes(BOMB))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(head + (15).to_bytes(4, "little") + len(content).to_bytes(4, "little") + content)


def large_bomb(path: Path) -> None:
    """A file of 8 MB that unpacks to 19 times its size."""
    clock = np.arange(7_500_000) * 1e-4
    noise = np.zeros(clock.size)
    noise[:830_000] = np.random.default_rng(1).random(830_000)
    np.savez_compressed(path, time=clock.round(0), x=noise)


def ended(way: str, name: str, run: Run) -> Cost:
    """Return the cost of a program that has ended."""
    lines = run.said.splitlines() or [""]
    last = lines[-1 if run.code else 0]
    shown = f"Traceback: {last}" if "Traceback (most recent" in run.said else last
    right = run.code > 0 or (run.code == 0 and name in LET_IN)
    return Cost(way, name, run.wall, run.cpu, run.megabytes, run.code, shown, right)


class Panel:
    """A panel that serves a folder, its processes and their cost."""

    def __init__(self, folder: Path) -> None:
        self._out = (folder.parent / "panel.txt").open("w+")
        command = [sys.executable, "-m", "stickslip", "panel", str(folder), "--port", "0", "--no-browser"]
        self.process = subprocess.Popen(command, stdout=self._out, stderr=subprocess.STDOUT)
        self.folder, address = folder, ""
        while not address:
            time.sleep(0.2)
            text = Path(self._out.name).read_text()
            address = next((one.split()[-1] for one in text.splitlines() if one.startswith("Panel:")), "")
            if self.process.poll() is not None:
                raise RuntimeError(text)
        self.client = httpx.Client(base_url=address, timeout=120.0, headers={"X-Client": "hostile"})

    def ids(self) -> list[int]:
        """Return the process and those that it started."""
        listed = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [self.process.pid, *(int(one) for part in listed for one in part.read_text().split())]

    def cpu(self) -> float:
        """Return the computing time of all processes [s]."""
        found = 0.0
        for one in self.ids():
            with suppress(OSError):
                fields = Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()
                found += sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
        return found

    def memory(self) -> list[float]:
        """Return the peak memory of the server and of the others since `forget` [MB]."""
        found = []
        for one in self.ids():
            with suppress(OSError, StopIteration):
                lines = Path(f"/proc/{one}/status").read_text().splitlines()
                found.append(int(next(l for l in lines if l.startswith("VmHWM")).split()[1]) / 1024)
        return found

    def forget(self) -> None:
        """Begin the peaks of memory anew."""
        for one in self.ids():
            with suppress(OSError):
                Path(f"/proc/{one}/clear_refs").write_text("5")

    def opened(self, case: Case, path: Path) -> Iterator[Cost]:
        """Upload a file, and open it in the folder."""
        if case.kind == "data":
            if path.stat().st_size < 32 * 2**20:
                yield self._uploaded(case.name, path.read_bytes())
            shutil.copy(path, self.folder / case.name)
            yield self._asked("listing", case.name, "/history/detail", {"name": case.name})
            (self.folder / case.name).unlink()
        elif case.kind == "json":
            place = self.folder / case.name.removesuffix(".json")
            place.mkdir()
            (place / "report.html").write_text("<html></html>")
            shutil.copy(path, place / "results.json")
            shutil.copy(path, place / "shown.json")
            yield self._asked("results", case.name, "/history", None)
            shutil.rmtree(place)
        else:
            shutil.copy(path, self.folder / case.name)
            asked = "/bench/load" if case.kind == "yaml" else "/history/detail"
            yield self._asked("load", case.name, asked, {"name": case.name})
            (self.folder / case.name).unlink()

    def _uploaded(self, name: str, content: bytes) -> Cost:
        """Upload a file and, where a preview of it is answered, take it."""
        cost = self._asked("upload", name, f"/history/upload?name={name}", content)
        if cost.code != 200:
            return cost
        asked = {"token": json.loads(cost.said)["token"], "name": "taken"}
        taken = self._asked("upload", name, "/history/take", asked)
        return taken._replace(
            wall=cost.wall + taken.wall,
            cpu=cost.cpu + taken.cpu,
            megabytes=max(cost.megabytes, taken.megabytes),
        )

    def _asked(self, way: str, name: str, route: str, body: object) -> Cost:
        self.forget()
        begun, before = time.perf_counter(), self.cpu()
        if body is None:
            answer = self.client.get(route)
        elif isinstance(body, bytes):
            answer = self.client.post(route, content=body)
        else:
            answer = self.client.post(route, json=body)
        wall = time.perf_counter() - begun
        said = answer.json() if answer.headers.get("content-type", "").startswith("application/json") else {}
        if "rows" in said:
            said = next((row for row in said["rows"] if row["name"] in name), {})
        shown = said.get("problem") or said.get("detail") or said.get("error") or json.dumps(said)
        code = answer.status_code
        right = name in LET_IN or code >= 400 or bool(said.get("problem"))
        cpu, megabytes = self.cpu() - before, max(self.memory())
        return Cost(f"panel, {way}", name, wall, cpu, megabytes, code, str(shown), right)

    def close(self) -> None:
        """End it."""
        self.client.close()
        self.process.terminate()
        self.process.wait(20)
        self._out.close()


@contextmanager
def serving(folder: Path) -> Iterator[Panel]:
    """Serve a folder."""
    folder.mkdir()
    panel = Panel(folder)
    try:
        panel.client.get("/history")
        yield panel
    finally:
        panel.close()


def opened(tell: Callable[[Cost], None], wanted: str = "", until: float = np.inf) -> list[Cost]:
    """Return the costs of all files whose names contain `wanted`, as far as the time `until` allows."""
    found: list[Cost] = []

    def note(cost: Cost) -> None:
        found.append(cost)
        tell(cost)

    with tempfile.TemporaryDirectory(prefix="hostile-") as kept:
        work = Path(kept) / "work"
        work.mkdir()
        with serving(Path(kept) / "lab") as panel, closing(Programs(work)) as programs:
            chosen = [one for one in cases() if wanted in one.name]
            random.Random(0).shuffle(chosen)  # of all kinds, where the time does not suffice for all
            for n, case in enumerate(chosen):
                if time.time() > until:
                    break
                path = work / f"{n}" / case.name  # alone: some makers leave more than one file
                path.parent.mkdir()
                case.make(path)
                for cost in panel.opened(case, path):
                    note(cost)
                code = CALLED.format(PYTHON[case.kind], str(path))
                note(ended("Python", case.name, programs.run(f"Python {case.kind}", code)))
                more = OTHERS[n % len(OTHERS)] if case.kind == "yaml" else ""
                for command in filter(None, (COMMAND[case.kind], more)):
                    asked = [command, str(path)] + [str(path)] * (command == "verify")
                    run = programs.run(command, COMMANDED.format(asked))
                    note(ended(f"stickslip {command}", case.name, run))
                shutil.rmtree(path.parent)
    return found


def wrong(cost: Cost) -> str:
    """Return what is violations: the cost, a file that was let in, an end without a sentence."""
    said = [f"{cost.cpu:.1f} s of computing"] if cost.cpu > SECONDS else []
    said += [f"{cost.megabytes:.0f} MB"] if cost.megabytes > MEGABYTES else []
    faulty = cost.said.startswith("Traceback") or cost.code < 0 or cost.code >= 500
    silent = bool(cost.code) and not cost.said
    if faulty or silent or not cost.right:
        said.append(f"code {cost.code}, {cost.said[:150]!r}")
    return ", ".join(said)


def _opener(cost: Cost) -> str:
    """Return what opened the file: Python, a command, or the panel."""
    return {"panel,": "panel", "stickslip": "commands"}.get(cost.way.split()[0], cost.way)


def measured(found: list[Cost], count: int) -> dict[str, str]:
    """Return the measured parts of the page."""
    ways = list(dict.fromkeys(_opener(one) for one in found))
    files = len({one.name for one in found})
    bad = [(one, wrong(one)) for one in found if wrong(one)]
    rows = []
    for way in ways:
        of = [one for one in found if _opener(one) == way]
        wall, cpu, most = (max(of, key=lambda one, k=k: one[k]) for k in (2, 3, 4))
        refused = sum(one.code not in (0, 200) for one in of)
        rows.append(
            f"| {way} | {len(of)} | {refused} | {wall.wall:.1f} | {cpu.cpu:.1f} | {most.megabytes:.0f} |"
        )
    head = (
        "| opened by | files opened | error | wall s, most | CPU s, most | MB, most |",
        "|---|---|---|---|---|---|",
    )
    return {
        "command": f"`python -m benchmarks.hostile_files --page`: {files} of {count} files, "
        f"load {os.getloadavg()[0]:.1f}.",
        "costs": "\n".join([*head, *rows]),
        "violations": "\n".join(
            [
                f"Violations: {len(bad)} of {len(found)}.",
                "",
                *(f"- {one.way}, `{one.name}`: {text}" for one, text in bad),
            ]
        ),
    }


def main() -> None:
    """Run it, print or write the page; exit code 1 if anything is violations."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hostile_files", description=__doc__)
    parser.add_argument("--only", default="", help="part of the names of files")
    parser.add_argument("--minutes", type=float, default=60.0, help="time after which no file is begun")
    parser.add_argument("--page", action="store_true", help="write the page of docs/benchmarks")
    given = parser.parse_args()

    def tell(cost: Cost) -> None:
        mark = f"WRONG {wrong(cost)}" if wrong(cost) else ""
        print(f"{cost.way:20} {cost.name:34} {cost.wall:5.1f} s {cost.cpu:5.1f} s {cost.megabytes:4.0f} MB "
              f"{cost.code:3} {cost.said[:110]!r} {mark}", flush=True)  # fmt: skip

    found = opened(tell, given.only, time.time() + 60.0 * given.minutes)
    parts = measured(found, len(list(cases())))
    print("\n\n".join(parts.values()))
    if given.page:
        write_page(PAGE, parts)
    raise SystemExit(any(wrong(one) for one in found))


if __name__ == "__main__":
    main()
