"""A twin is compiled before it serves: drivers wait a second or two for the answer to a command."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
import numpy as np
from numba.core import event
import stickslip as ss
from stickslip.twins.stage import Piece, Stage

with event.install_recorder("numba:compile") as made:
    stage = Stage(ss.load_actuator(sys.argv[1]))
with event.install_recorder("numba:compile") as moving:
    stage.play(Piece(np.array([1e-3, 2e-3]), np.array([10.0, 0.0]), np.linspace(0.0, 2e-3, 5)))
    stage.rest(1.0)
print(len(made.buffer), len(moving.buffer))
"""


@pytest.mark.parametrize("actuator", ["kang2007", "kang2007-hysteresis"])
def test_nothing_is_compiled_while_it_moves(actuator: str, tmp_path: Path) -> None:
    environment = {**os.environ, "STICKSLIP_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, actuator], capture_output=True, text=True, check=True, env=environment
    )
    at_first, moving = map(int, done.stdout.split())
    # What a piezo makes of a drive is compiled; without one, nothing is.
    assert (at_first > 0) == (actuator == "kang2007-hysteresis")
    assert moving == 0
