"""Twins on a port of this machine, and drivers by others that move them, each in a process of its own."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from stickslip.physics.actuator import load_actuator
from stickslip.rig.twins import TwinServer, make_twin

ROOT = Path(__file__).parents[2]
DRIVERS = Path(__file__).parent / "drivers"
ACTUATOR = load_actuator("kang2007-hysteresis")


class TestClock:
    """Time that goes on when it is told to."""

    __test__ = False

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds


@contextmanager
def served(twin: Any) -> Iterator[int]:
    """The port of a twin, until the end of the context."""
    with TwinServer(twin) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()


def twin_of(name: str, **changes: Any) -> Any:
    """A twin on the actuator with hysteresis and creep, its stages not far from the middle."""
    made = {"axes": 3, "travel": 4e-4, "seed": 4} | changes
    return make_twin(name, made.pop("actuator", ACTUATOR), **made)


@cache
def drivers_python() -> str:
    """The Python that has others' drivers; the Makefile makes it where it is not there."""
    subprocess.run(["make", "--silent", "drivers"], cwd=ROOT, check=True, timeout=600)
    return str(ROOT / ".venv-drivers/bin/python")


def environment(**more: str) -> dict[str, str]:
    """Of a process that has others' drivers."""
    return {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT / "src"), "HOME": str(Path.home()), **more}


def drive(script: Path | str, *given: Any, **more: str) -> dict[str, Any]:
    """What a script says of how it went: a driver's, or an example; `more` is of its environment."""
    done = subprocess.run(
        [drivers_python(), "-W", "ignore", str(DRIVERS / script), *map(str, given)],
        capture_output=True,
        text=True,
        timeout=180,
        env=environment(**more),
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])
