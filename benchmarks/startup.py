"""How long a newcomer waits: the import, the first simulation, the first compilation, in fresh processes."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version

from .session import Row

IMPORT = "import stickslip as ss"
SIMULATION = f"""
{IMPORT}
ss.simulate(ss.load_actuator("kang2007"), ss.Sawtooth(amplitude=65.0, frequency=5.0), duration=1.6)
"""


def measure_startup() -> tuple[list[Row], dict[str, str]]:
    """Rows with the median and the longest wall time, s, and what was aimed at."""
    empty = min(_seconds("pass", {}) for _ in range(5))
    rows = [
        _row("import stickslip", [_seconds(IMPORT, {}) - empty for _ in range(11)], 0.3),
    ]
    with tempfile.TemporaryDirectory() as cache:
        place = {"STICKSLIP_CACHE_DIR": cache}
        cold = _seconds(SIMULATION, place) - empty
        rows.append(
            _row(
                "import and first simulation, kernels compiled before",
                [_seconds(SIMULATION, place) - empty for _ in range(7)],
                0.5,
            )
        )
    rows.append(_row("import and first simulation, kernels to be compiled", [cold], 15.0))
    return rows, {name: version(name) for name in ("stickslip", "numba", "numpy", "xarray")}


def _seconds(program: str, environment: dict[str, str]) -> float:
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", program], env={**os.environ, **environment}, check=True, timeout=120
    )
    return time.perf_counter() - start


def _row(what: str, seconds: list[float], limit: float) -> Row:
    return {
        "part": "startup",
        "problem": "",
        "tool": "stickslip",
        "method": "fresh process, less an empty one",
        "setting": what,
        "repeats": len(seconds),
        "wall_s_median": statistics.median(seconds),
        "wall_s_min": min(seconds),
        "wall_s_max": max(seconds),
        "limit_s": limit,
    }
