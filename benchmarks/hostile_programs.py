"""Programs and commands that open files, each in a process of its own, at the cost of few starts."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

# Runs programs in children of a process that has run one of their kind and so has imported what they need.
# A child's memory is what it adds to that of the process, whose libraries are not counted in the child's own.
PARENT = """
import json, os, resource, sys, time, traceback

def act(code):
    file = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(file, 1), os.dup2(file, 2), os.close(file)
    try:
        exec(code, {"__name__": "__main__"})
        ended = 0
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        ended = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        ended = 1
    sys.stdout.flush(), sys.stderr.flush()
    return ended

def ran(work):
    begun = time.perf_counter()
    if not (child := os.fork()):
        resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
        os._exit(work())
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return time.perf_counter() - begun, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, code

answers, begun = os.fdopen(os.dup(1), "w"), time.perf_counter()
act(json.loads(sys.stdin.readline()))
wall, cpu = time.perf_counter() - begun, time.process_time()
status = open("/proc/self/status").read().splitlines()
peak = int(next(line for line in status if line.startswith("VmHWM")).split()[1]) / 1024
empty = ran(lambda: 0)[2]
for line in sys.stdin:
    found = ran(lambda: act(json.loads(line)) % 256)
    one = found[0] + wall, found[1] + cpu, peak + max(found[2] - empty, 0.0), found[3]
    print(json.dumps(one), file=answers, flush=True)
"""
COMMANDED = (
    "import runpy, sys; sys.argv = ['stickslip', *{!r}]; runpy.run_module('stickslip', run_name='__main__')"
)


class Run(NamedTuple):
    """Cost of a program [s, s, MB], its exit code, and what it said."""

    wall: float
    cpu: float
    megabytes: float
    code: int
    said: str


class Programs:
    """Processes, one for each kind of program, that have imported what that kind needs."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._out = folder, folder.parent / "said.txt"
        self._parents: dict[str, subprocess.Popen[str]] = {}

    def run(self, kind: str, code: str) -> Run:
        """Return what a program of a kind took, its start included, and said."""
        if kind not in self._parents:
            self._parents[kind] = subprocess.Popen(
                [sys.executable, "-c", PARENT, str(self._out)],
                cwd=self._folder,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            self._ask(kind, code)
        self._ask(kind, code)
        stdout = self._parents[kind].stdout
        assert stdout is not None
        wall, cpu, megabytes, ended = json.loads(stdout.readline())
        said = self._out.read_text(errors="replace")[:100_000].strip()
        return Run(wall, cpu, megabytes, ended, said)

    def _ask(self, kind: str, code: str) -> None:
        stdin = self._parents[kind].stdin
        assert stdin is not None
        stdin.write(json.dumps(code) + "\n")
        stdin.flush()

    def close(self) -> None:
        """End the processes."""
        for parent in self._parents.values():
            parent.kill()
            parent.wait()
