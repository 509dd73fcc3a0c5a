"""A law in the user's own file: cached on disk, never stale, and the same without the compiler.

Each test runs real processes, for what is asked is what the next process gets.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import stickslip

OWN_LAW = """
from typing import NamedTuple
from stickslip.friction import register

class Spring(NamedTuple):
    stiffness: float

def spring(law, v, z):
    return law.stiffness * z + 3.0 * v, v

register(Spring, spring)
"""

PROGRAM = """
import own_law
from stickslip._jit import kernel
from stickslip.friction import LuGre, rate
from stickslip.friction.law import element, project

@kernel
def one_force(law, v, z):
    return rate(element(law, 0), v, project(law, z))[0]

print(one_force(own_law.Spring(10.0), 1.0, 2.0), one_force(LuGre(1e6, 0.0, 0.0, 0.5, 0.5), 1.0, 1e-7))
"""

COMPILES = "compiling"  # what the user is told on stderr


class Run(NamedTuple):
    """What a process printed: a force by the user's law, one by LuGre, and whether it compiled."""

    own: float
    lugre: float
    compiled: bool


@pytest.fixture
def folder(tmp_path):
    """A user's folder with a law and a program, and a copy of the package that may be edited."""
    (tmp_path / "own_law.py").write_text(OWN_LAW)
    (tmp_path / "program.py").write_text(PROGRAM)
    source = Path(stickslip.__file__).parent
    shutil.copytree(source, tmp_path / "stickslip", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def run(folder: Path, jit: bool = True) -> Run:
    """Start the program in a new process; as a module, since __main__ has no name in the next one."""
    environment = os.environ | {
        "PYTHONPATH": str(folder),
        "STICKSLIP_CACHE_DIR": str(folder / "cache"),
        "NUMBA_DISABLE_JIT": "0" if jit else "1",
        "PYTHONDONTWRITEBYTECODE": "1",  # Python takes two edits in one second for one
    }
    command = [sys.executable, "-c", "import program"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    own, lugre = map(float, done.stdout.split())
    return Run(own, round(lugre, 12), COMPILES in done.stderr)


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1
    file.write_text(text.replace(old, new))


@pytest.mark.compiled
def test_compiled_laws_are_kept_and_no_edit_is_ever_stale(folder):
    assert run(folder) == (23.0, 0.1, True)
    assert run(folder) == (23.0, 0.1, False)
    edit(folder / "own_law.py", "3.0 * v", "4.0 * v")
    assert run(folder) == (24.0, 0.1, True)
    physics = "return law.sigma_0 * z + sigma_1"
    edit(folder / "stickslip" / "friction" / "lugre.py", physics, physics.replace("return", "return 2.0 *"))
    assert run(folder) == (24.0, 0.2, True)


@pytest.mark.compiled
def test_compiled_laws_of_a_file_named_by_its_path_are_kept_too(folder):
    load = f"from stickslip.registry import use_file\nown_law = use_file({str(folder / 'own_law.py')!r})"
    edit(folder / "program.py", "import own_law", load)
    assert run(folder) == (23.0, 0.1, True)
    assert run(folder) == (23.0, 0.1, False)
    edit(folder / "program.py", load, "import own_law")  # another name for the same file
    assert run(folder) == (23.0, 0.1, True)


def test_own_law_runs_without_the_compiler(folder):
    assert run(folder, jit=False) == (23.0, 0.1, False)
