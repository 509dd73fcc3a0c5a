"""Wrong signs in the C of the engine, and the engine built with one of them.

One at a time, + becomes - and back, a minus of its own is dropped, a comparison is turned round. Not where
whole numbers and addresses are reckoned, which would write beyond an array: in brackets [ ], in the head of a
`for`, in an `enum` or a `case`, and in what declares or returns a whole number or a pointer; nor in
directives of the preprocessor, comments and strings. Generated files stay as they are: their Python is
changed instead. A change that does not compile, or crashes, counts as noticed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mutate_c_lines import NOT_NOTICED, SAME

# Without optimisation the engine is compiled in half the time, and takes the same steps.
FLAGS = ("-O0", "-std=c99", "-ffp-contract=off", "-fPIC", "-fvisibility=hidden")
GENERATED = "Generated"  # in the first comment of a file

NO_CODE = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\])*"|^[ \t]*#(?:[^\n]*\\\n)*[^\n]*', re.DOTALL | re.MULTILINE)
HEAD = re.compile(r"\bfor \([^{}]*?;[^{}]*?;[^{}]*?\)(?=\n| \{)")
NUMBERS = re.compile(r"\benum(?: \w+)? \{[^{}]*\}|\bcase [^:]*:")
BRACKETS = re.compile(r"\[[^\[\]]*\]")
WHOLE = r"(?:bool|char|int|int32_t|int64_t|size_t|uint32_t)"
# A statement whose value is a whole number or an address.
NO_SUM = re.compile(rf"\s*(?:(?:static|inline|const) )*(?:{WHOLE} |\w+ \*\w|struct [\w()]+ \*)")
STATEMENT = re.compile(r"[^;{}]+[;{}]")

SUMS = (
    (r"(?<=[\w)\]]) \+(?=\s)", " -"),
    (r"(?<=[\w)\]]) -(?=\s)", " +"),
    (r" \+= ", " -= "),
    (r" -= ", " += "),
)
OWN_MINUS = r"(?<![\w)\]\-])(?<![\w)\]] )-(?=[\w(])"
OTHERS = (
    (OWN_MINUS, ""),
    (r" < ", " > "),
    (r" > ", " < "),
    (r" <= ", " >= "),
    (r" >= ", " <= "),
    (r" == ", " != "),
    (r" != ", " == "),
)


class Change(NamedTuple):
    """One change: its line, what was changed into what, and the new source."""

    line: int
    change: str
    source: str


def _blank(found: re.Match[str]) -> str:
    """Spaces in the place of a text, whose lines stay."""
    return re.sub(r"[^\n]", " ", found.group())


def code(source: str) -> str:
    """Return a C source in which all that is no floating-point code is blank."""
    for nothing in (NO_CODE, HEAD, NUMBERS):
        source = nothing.sub(_blank, source)
    before = ""
    while before != source:
        # What stands in brackets becomes a name: [i - 1] is one operand.
        before, source = source, BRACKETS.sub(lambda found: "_" * len(found.group()), source)
    return source


def changes(source: str, name: str = "") -> Iterator[Change]:
    """Every change of a C source but for the lines of `mutate_c_lines`; none of a generated one."""
    left_out = (*SAME.get(name, ()), *NOT_NOTICED.get(name, ()))
    known = {line.strip() for line in source.splitlines()}
    if not known.issuperset(left_out):
        sys.exit(f"mutate: {name} has no line {sorted(set(left_out) - known)}: correct mutate_c_lines")
    if GENERATED in source.partition("*/")[0]:
        return
    for statement in STATEMENT.finditer(code(source)):
        signs = OTHERS if NO_SUM.match(statement.group()) else (*SUMS, *OTHERS)
        for sign, opposite in signs:
            for found in re.finditer(sign, statement.group()):
                start, end = (statement.start() + at for at in found.span())
                new = source[:start] + opposite + source[end:]
                number = source.count("\n", 0, end)
                before, after = (text.splitlines()[number].strip() for text in (source, new))
                if before in left_out:
                    continue
                yield Change(number + 1, f"{before} -> {after}", new)


def _compiler() -> str:
    found = os.environ.get("CC") or shutil.which("cc") or "gcc"
    return found


def _compiled(file: Path, folder: Path, further: Sequence[str] = ()) -> None:
    made = folder / f"{file.stem}.o"
    subprocess.run([_compiler(), *FLAGS, *further, "-MMD", "-c", str(file), "-o", str(made)], check=True)


def objects(sources: Path, folder: Path, *further: str) -> None:
    """Compile the unchanged engine, with a list beside each object of the files that it is made of.
    `further`: options of the compiler."""
    folder.mkdir()
    for file in sorted(sources.glob("*.c")):
        _compiled(file, folder, further)


def link(engine: Path, parts: Sequence[Path], *further: str) -> None:
    """Link objects to the library of a copy of the package; `further`: options of the compiler."""
    made = next(engine.glob("_engine.*"))
    made.unlink()
    subprocess.run([_compiler(), *further, "-shared", *map(str, parts), "-o", str(made), "-lm"], check=True)


def build(sources: Path, changed: str, known: Path) -> None:
    """Build the engine of a copy of the package beside its Python: what a changed file is part of is compiled
    again, the rest are the objects that are known.

    Args:
        sources: the folder of the copy's C.
        changed: name of the file in it that was changed.
        known: see `objects`.

    Raises:
        subprocess.CalledProcessError: it does not compile.
    """
    parts = []
    for file in sorted(sources.glob("*.c")):
        part = known / f"{file.stem}.o"
        if re.search(rf"\b{re.escape(changed)}\b", part.with_suffix(".d").read_text()):
            _compiled(file, sources)
            part = sources / part.name
        parts.append(part)
    link(sources.parent, parts)
