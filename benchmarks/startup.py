"""How long a newcomer waits: the import and the first simulation, in fresh processes."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from importlib.metadata import version

from .session import Row

IMPORT = "import stickslip as ss"
SIMULATION = f"""
{IMPORT}
ss.simulate(ss.load_actuator("kang2007"), ss.Sawtooth(amplitude=65.0, frequency=5.0), duration=1.6)
"""
# What a first simulation imports, so that its byte code is there, as after the first use of an installation.
LIBRARIES = "import pint, scipy.linalg, xarray; pint.UnitRegistry()"


def measure_startup() -> tuple[list[Row], dict[str, str]]:
    """Rows with wall and CPU times, s, less those of an empty process, and what was aimed at."""
    with tempfile.TemporaryDirectory() as folder:
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        place = kept | {"PYTHONPYCACHEPREFIX": folder}
        _process(LIBRARIES, place)
        empty = [_process("pass", place) for _ in range(5)]
        _process(SIMULATION, place)
        simulation = [_process(SIMULATION, place) for _ in range(7)]
        imported = [_process(IMPORT, place) for _ in range(11)]
    rows = [
        _row("import stickslip", imported, empty, 0.3),
        _row("import and first simulation", simulation, empty, 0.5),
    ]
    return rows, {name: version(name) for name in ("stickslip", "numpy", "pint", "xarray")}


def _process(program: str, environment: Mapping[str, str]) -> tuple[float, float]:
    """Wall and CPU time of a process, s."""
    wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", program]
    subprocess.run(command, env=environment, check=True, timeout=180, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - wall, cpu


def _row(what: str, times: list[tuple[float, float]], empty: list[tuple[float, float]], limit: float) -> Row:
    nothing = [min(column) for column in zip(*empty, strict=True)]
    walls, cpus = zip(*times, strict=True)
    return {
        "part": "startup",
        "problem": "",
        "tool": "stickslip",
        "method": "fresh process",
        "setting": what,
        "repeats": len(times),
        "wall_ms_median": 1e3 * (statistics.median(walls) - nothing[0]),
        "wall_ms_min": 1e3 * (min(walls) - nothing[0]),
        "cpu_ms_median": 1e3 * (statistics.median(cpus) - nothing[1]),
        "cpu_ms_min": 1e3 * (min(cpus) - nothing[1]),
        "limit_ms": 1e3 * limit,
    }
