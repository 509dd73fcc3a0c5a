"""Exports that tests compile and run."""

from __future__ import annotations

import io
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.export import export_c

WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion"]
WARNINGS += ["-Wsign-conversion", "-Wshadow", "-Wdouble-promotion", "-Werror"]
# gcc must be there; what else is there is used too.
COMPILERS = ["gcc", *filter(shutil.which, ["clang"])]
ARM_COMPILERS = [*filter(shutil.which, ["arm-none-eabi-gcc"])]
C = Path(__file__).parent


def compiled(folder: Path, program: Path, *flags: str, compiler: str = "gcc", name: str = "program") -> Path:
    """An exported model with a main program, compiled."""
    made = folder / name
    sources = [program, folder / "stickslip.c", folder / "stickslip_parameters.c"]
    command = [
        compiler,
        *WARNINGS,
        *(flags or ("-O2",)),
        f"-I{folder}",
        *map(str, sources),
        "-o",
        str(made),
        "-lm",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return made


def output(program: Path, *arguments: str, text: str = "") -> str:
    """What a program prints; it must end well and say nothing on stderr (the sanitizers do)."""
    done = subprocess.run(
        [program, *arguments], input=text, capture_output=True, text=True, check=False, timeout=500
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout


def walk(source: Any, folder: Path, *flags: str, **options: Any) -> np.ndarray:
    """The walk of the example program, as columns by name."""
    export_c(source, folder, **options)
    program = compiled(folder, folder / "host" / "walk.c", *(flags or ("-O2",)))
    return np.genfromtxt(io.StringIO(output(program)), delimiter=",", names=True)
