"""Open the compiled engine, a library beside this file, built by CMake and opened through cffi."""

from __future__ import annotations

import functools
import hashlib
import sys
from pathlib import Path
from typing import Any

from ._abi import ffi

# Suffix and path of the library, which native/CMakeLists.txt puts beside this file.
SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
FILE = Path(__file__).with_name(f"_engine{SUFFIX}")
# Folder of the engine's C sources. They are needed at run time: compiled laws of users include them, NVRTC
# compiles them for a GPU, and exported code contains them.
SOURCES = Path(__file__).with_name("c")


class EngineMissingError(ImportError):
    """Error: the compiled engine is missing, or was built for another machine or from other sources."""


@functools.cache
def library() -> Any:
    """Return the engine, opened as a library.

    Raises:
        EngineMissingError: it was not built, does not fit this machine, or was built from other sources.
    """
    what_to_do = "Install stickslip again, on a machine with a C compiler; in a checkout, run `make engine`"
    try:
        found: Any = ffi.dlopen(str(FILE))
        built_from = found.stickslip_abi()
    except (OSError, AttributeError) as error:
        raise EngineMissingError(f"{FILE} cannot be opened ({error}). {what_to_do}.") from None
    if built_from != found.STICKSLIP_ABI:
        raise EngineMissingError(f"{FILE} was built from other sources. {what_to_do}.")
    return found


@functools.cache
def sources_hash() -> str:
    """Return the SHA-256 hash of the engine's C sources, in hexadecimal; equal on all machines that have the
    same sources. Results of another engine may differ."""
    found = hashlib.sha256()
    for file in sorted(SOURCES.iterdir()):
        found.update(file.name.encode() + file.read_bytes())
    return found.hexdigest()


@functools.cache
def packaged(interface: str) -> dict[str, Any]:
    """Return pointers to the C structs of the package's own records, by the name of the record's class.

    `interface` is the name of the struct: "law" for friction laws, "duhem" for hysteresis of Duhem's form."""
    found, i = {}, 0
    every = getattr(library(), f"stickslip_packaged_{interface}")
    while law := every(i):
        name: Any = ffi.string(law.name)
        found[name.decode()] = law
        i += 1
    return found
