"""Compile a user's friction law or piezo model, translated to C, with the machine's C compiler."""

from __future__ import annotations

import functools
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from ._abi import ffi
from .interface import Interface
from .library import SOURCES
from .translator import Record, Translation, TranslationError

# Flags of the compiler. Fused multiply-add is off, so that C rounds as Python does.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared", "-fPIC")
LONGEST = 60.0  # time after which a compiler that hangs is stopped, s


@functools.cache
def compiler() -> tuple[str, ...] | None:
    """Return the command of the machine's C compiler, split into words: the variable CC, else cc, gcc or
    clang; None without a compiler, or on Windows."""
    if sys.platform == "win32":  # Microsoft's compiler does not understand `FLAGS`
        return None
    given = shlex.split(os.environ.get("CC", ""))
    for command in (given, ["cc"], ["gcc"], ["clang"]):
        if command and shutil.which(command[0]):
            return tuple(command)
    return None


def source(kind: Record, interface: Interface) -> str:
    """Return the C source of a record type, with an exported function stickslip_packaged_NAME(i) that returns
    a pointer to its struct for i = 0. NAME is that of the interface.

    Args:
        kind: the translator's type of the record.
        interface: declaration of the C struct, for friction laws or for piezo models.

    Raises:
        TranslationError: a function of the law cannot be translated.
    """
    made = Translation()
    law = interface.c_of(made, kind)
    name, struct = f"{interface.name}_{kind.record_class.__name__}", f"struct {interface.name}"
    declared = f"const {struct} *stickslip_packaged_{interface.name}(int32_t i)"
    return "\n".join(
        [
            "#include <stddef.h>\n",
            f'#include "{interface.header}"\n',
            made.text(),
            law,
            f'__attribute__((visibility("default"))) {declared};',
            f"{declared}\n{{",
            f"    return i == 0 ? &{name} : NULL;\n}}\n",
        ]
    )


def compiled(record: Any, kind: Record, interface: Interface) -> tuple[Any, Any] | None:
    """Return a pointer to the C struct of a compiled law, and the opened library, which must exist as long.
    Return None if there is no compiler, or the law cannot be translated or compiled.

    The arguments are those of `called_back.law`; `record` is not used."""
    command = compiler()
    if command is None:
        return None
    try:
        text = source(kind, interface)
    except TranslationError:
        return None
    # Only this user can access the folder, so nobody can replace the library before it is opened. An opened
    # library stays loaded when its file is deleted.
    with tempfile.TemporaryDirectory(prefix="stickslip-", ignore_cleanup_errors=True) as folder:
        file, library = Path(folder, "law.c"), Path(folder, "law.so")
        file.write_text(text, encoding="utf-8")
        run = [*command, *FLAGS, f"-I{SOURCES}", str(file), "-o", str(library), "-lm"]
        try:
            subprocess.run(run, check=True, capture_output=True, timeout=LONGEST)
            opened: Any = ffi.dlopen(str(library))
        except (OSError, subprocess.SubprocessError):
            return None
    return getattr(opened, f"stickslip_packaged_{interface.name}")(0), opened
