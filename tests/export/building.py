"""Exports that tests compile and run."""

from __future__ import annotations

import atexit
import functools
import hashlib
import io
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from engine import library
from stickslip.export import export_c, export_fmu
from stickslip.export.variables import Mode

WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Wshadow"]
WARNINGS += ["-Wdouble-promotion", "-Werror"]
FLOAT = ["-O2", "-DSTICKSLIP_FLOAT"]
# Without checks of pointers, which the tests of the engine have: they take a third of the time.
SANITIZED = [
    *library.SANITIZED,
    "-fno-sanitize=null,alignment,pointer-overflow,object-size,nonnull-attribute",
]
QUICK = ["-O0"]  # for short runs of a model that no other test compiles
QUICK_FLOAT = ["-O0", "-DSTICKSLIP_FLOAT"]
# gcc must be there; what else is there is used too.
COMPILERS = ["gcc", *filter(shutil.which, ["clang"])]
ARM_COMPILERS = [*filter(shutil.which, ["arm-none-eabi-gcc"])]
C = Path(__file__).parent
CORE = ["stickslip.c", "stickslip.h", "stickslip_equations.h", "stickslip_layout.h"]
OBJECTS = Path(tempfile.mkdtemp(prefix="stickslip-objects-"))
atexit.register(shutil.rmtree, OBJECTS)


def compiled(folder: Path, program: Path, *flags: str, compiler: str = "gcc", name: str = "program") -> Path:
    """An exported model with a main program, compiled."""
    made = folder / name
    how = [compiler, *WARNINGS, *(flags or ("-O2",))]
    objects = [_object(folder, name, how) for name in (CORE[0], "stickslip_parameters.c")]
    _run([*how, f"-I{folder}", *map(str, [program, *objects]), "-o", str(made), "-lm"])
    return made


def _object(folder: Path, source: str, how: list[str]) -> Path:
    """One file compiled, once: the model's code is the same of many actuators, but for its heading, which the
    numbers begin with too; and these are the same of many programs."""
    texts = [(folder / name).read_text() for name in (source, *CORE[1:])]
    if source == CORE[0]:
        texts = [re.sub(r"^/\*.*?\*/", "", text, flags=re.DOTALL) for text in texts]
    made = OBJECTS / f"{hashlib.sha256(repr([how, texts]).encode()).hexdigest()}.o"
    if not made.exists():
        _run([*how, "-c", str(folder / source), "-o", str(made)])
    return made


def packaged_fmu(fmi: int, mode: Mode = "plant") -> Path:
    """Return kang2007 in steps of 20 us, made once."""
    return _packaged(fmi, mode)


@functools.cache
def _packaged(fmi: int, mode: Mode) -> Path:
    return export_fmu("kang2007", OBJECTS / f"{mode}{fmi}", fmi=fmi, mode=mode)


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


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
    return _example("walk", source, folder, *flags, **options)


def scan(source: Any, folder: Path, *flags: str, **options: Any) -> np.ndarray:
    """The wanted motion and that of the example program of the feedforward, as columns by name."""
    return _example("scan", source, folder, *flags, **options)


def _example(name: str, source: Any, folder: Path, *flags: str, **options: Any) -> np.ndarray:
    export_c(source, folder, **options)
    program = compiled(folder, folder / "host" / f"{name}.c", *(flags or ("-O2",)))
    return np.genfromtxt(io.StringIO(output(program)), delimiter=",", names=True)
