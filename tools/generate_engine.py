"""Write the files of the engine that are made from others (`make laws`): the laws in C, and cffi's
description of its headers, so that nothing is parsed when the package is imported."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

from cffi import FFI

from stickslip.engine import laws

ENGINE = Path(laws.__file__).parent
# In the order of their includes.
HEADERS = ("law.h", "packaged.h")
# Inside headers that Python reads: preprocessor lines but for numbers, comments, functions with a body.
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_NUMBER = re.compile(r"#define \w+ \d+")
_TABLE = re.compile(r"static const [^=;]*=[^;]*;")
_BODY = re.compile(r"static inline [^;{]*\{")


def declarations(headers: list[str]) -> str:
    """The types and functions that headers declare, as cffi reads them."""
    text = "\n".join(_COMMENT.sub("", header).replace("\\\n", " ") for header in headers)
    lines = text.splitlines()
    text = "\n".join(
        one for one in lines if not one.lstrip().startswith("#") or _NUMBER.fullmatch(one.strip())
    )
    text = _TABLE.sub("", text)
    while found := _BODY.search(text):
        end, depth = found.end(), 1
        while depth:
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        text = text[: found.start()] + text[end:]
    return "typedef double real_t;\n" + text.replace("STICKSLIP_API ", "").replace("volatile ", "")


def description() -> str:
    """The text of ``_abi.py``."""
    ffi = FFI()
    ffi.cdef(declarations([(ENGINE / "c" / name).read_text("ascii") for name in HEADERS]))
    ffi.set_source("stickslip.engine._abi", None)
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "_abi.py"
        ffi.emit_python_code(str(made))
        return made.read_text("ascii")


def generated() -> dict[Path, str]:
    """Every file and its text."""
    files = {ENGINE / "c" / name: text for name, text in laws.generated().items()}
    return {**files, ENGINE / "_abi.py": description()}


if __name__ == "__main__":
    for file, content in generated().items():
        file.write_text(content, encoding="ascii")
