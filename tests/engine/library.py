"""How the tests call the engine, and build it with other flags."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

from stickslip.engine import binding
from stickslip.engine.library import SOURCES

WARNINGS = ["-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Wshadow", "-Werror"]
SANITIZED = ["-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
STRICT = ["-std=c99", "-ffp-contract=off", "-fPIC", "-shared"]


def integrate(
    plant: Any,
    drive: Any,
    load: Any,
    q: Any,
    span: tuple[float, float],
    *further: Any,
    resume: Any = None,
    account: Any = None,
) -> tuple[int, float, int, int]:
    """`binding.integrate` of a plant and tables as Python has them."""
    made = binding.ComposedPlant(plant), binding.DriveTable(drive), binding.DriveTable(load)
    return binding.integrate(*made, q, span, *further, resume, account)


def built(folder: Path, *flags: str, of: str = "") -> Path:
    """The engine's sources, or a C text instead, compiled into a library in a folder."""
    files = sorted(map(str, SOURCES.glob("*.c")))
    if of:
        files = [str(folder / "text.c")]
        Path(files[0]).write_text(of)
    made = folder / "engine.so"
    subprocess.run(["cc", *STRICT, *flags, f"-I{SOURCES}", *files, "-o", str(made), "-lm"], check=True)
    return made
