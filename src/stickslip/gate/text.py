"""Parse JSON and TOML from outside within limits (`gate.yaml_text` parses YAML), and unpack gzip data.

Nesting depth, values and digits are counted in the text before a parser builds anything, so a file of a few
kilobytes can exhaust neither the stack nor the memory. Every failure is a `GateError`: one sentence with the
name of the file.
"""

from __future__ import annotations

import codecs
import gzip
import io
import json
import os
import re
import tomllib
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .elsewhere import applied
from .errors import GateError
from .files import opened

# Largest size of a file that a person writes (input file, parameter set), bytes.
MOST_BYTES = 1_000_000
# Largest size of a JSON file that a program wrote, bytes: about 5 million numbers.
MOST_RESULT_BYTES = 100_000_000
# Largest nesting depth of lists and mappings; the package's own files have up to 9 levels.
MOST_DEPTH = 64
# Largest number of lists and mappings in a JSON text; twice as many quoted texts are allowed.
MOST_VALUES = 1_000_000
# Largest number of commas, and so of values, in a JSON text; each value takes 32 bytes of memory.
MOST_NUMBERS = 5_000_000
# Largest number of digits of a number: a float has up to 25, and a seed of 128 bits has 39.
MOST_DIGITS = 100
# Number of bytes at the start of a file that are searched for a zero byte: a text file contains none.
_LOOKED_AT = 1000
# All bytes except brackets, which are deleted to count the brackets.
_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
# Pattern of a quoted text, even of one without an end quote. Because a match cannot fail, it is not tried
# again from the next quote, so the search takes linear time.
_JSON_TEXT = re.compile(rb'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)
_DIGITS = re.compile(rb"(?<![0-9])[0-9]{%d}" % (MOST_DIGITS + 1))
_HALF_LETTER = re.compile(rb"\\u[dD][89abAB]|\\u[dD][c-fC-F]")
_TOML_PARTS = re.compile(
    r"""
    (?P<text> \"\"\"(?:[^"\\]++|\\.|"(?!""))*+(?:\"{3,5})? | '''(?:[^']++|'(?!''))*+(?:'{3,5})?
            | "(?:[^"\\\n]++|\\.)*+"? | '[^'\n]*+'? )
    | (?P<comment> \#[^\n]*+)
    | (?P<open> [\[{]) | (?P<close> [\]}]) | (?P<word> [\w.+:-]++) | (?P<other> [=,\n])
    """,
    re.VERBOSE | re.DOTALL,
)


def read_file(path: str | os.PathLike[str], most: int = MOST_BYTES) -> bytes:
    """Return the bytes of a regular file of up to `most` bytes.

    Raises:
        GateError: the path is no regular file (a folder, a pipe, a device), or the file is larger.
        OSError: the file cannot be read.
    """
    with opened(path) as file:
        raw = file.read(most + 1)
        if len(raw) > most:
            raise too_large(str(path), max(len(raw), os.fstat(file.fileno()).st_size), most)
    return raw


def parsed(load: Callable[[bytes, str], Any], path: str | os.PathLike[str], most: int = MOST_BYTES) -> Any:
    """Return the content of a text file of up to `most` bytes. A server that has called `interpret_in` parses
    the file in the separate process (see `gate.elsewhere`).

    Args:
        load: `load_json`, `load_toml` or `load_yaml`.
        path: path of the file.
        most: largest size of the file, bytes.

    Raises:
        GateError: the file is too large or not valid, or reading it exceeded a limit; GateBusy (a GateError):
            the separate process could not read it now.
        OSError: the file cannot be read.
    """
    return applied(partial(_loaded, load=load, most=most), Path(path))


def read_json(path: str | os.PathLike[str], most: int = MOST_RESULT_BYTES) -> Any:
    """Return the content of a JSON file of up to `most` bytes. Raises the errors of `parsed`."""
    return parsed(load_json, path, most)


def _loaded(path: Path, load: Callable[[bytes, str], Any], most: int) -> Any:
    return load(read_file(path, most), str(path))


def unzipped(raw: bytes, source: str, most: int = MOST_RESULT_BYTES) -> bytes:
    """Return the uncompressed bytes of gzip data; `source` names the file in errors.

    Raises:
        GateError: the data are damaged, or unpack to more than `most` bytes.
    """
    try:
        found = gzip.GzipFile(fileobj=io.BytesIO(raw)).read(most + 1)
    # Damaged gzip data raise OSError, EOFError, ValueError or zlib.error.
    except Exception as error:
        raise GateError(f"{source}: damaged gzip data ({error})") from error
    if len(found) > most:
        raise GateError(f"{source}: its content has more than {most / 1e6:g} MB")
    return found


def decoded(raw: bytes | str, source: str) -> str:
    """Return UTF-8 bytes as text in which all line ends are LF; `source` names the file in errors.

    Text that is already decoded is returned unchanged.

    Raises:
        GateError: the bytes are not UTF-8; the message says what they seem to be.
    """
    if isinstance(raw, str):
        return raw
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b"\0" in raw[:_LOOKED_AT]:
        raise GateError(f"{source}: it is in UTF-16, or no text at all; save it as UTF-8")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise GateError(
            f"{source}: line {line} has a letter that is not in UTF-8, of Latin-1 say; save it as UTF-8"
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def load_json(raw: bytes | str, source: str) -> Any:
    """Return the content of a JSON text.

    Args:
        raw: the text, or its bytes in UTF-8.
        source: name of the text in errors, such as the path of its file.

    Raises:
        GateError: the text is no JSON or not UTF-8, is nested too deeply, has too many values or a number of
            too many digits, gives a name twice, or contains half a character (a lone surrogate).
    """
    written = raw if isinstance(raw, bytes) else raw.encode("utf-8", "surrogatepass")
    text = decoded(raw, source)
    _check_json(written, source)
    try:
        found = json.loads(text, object_pairs_hook=_mapping)
        if _HALF_LETTER.search(written):
            json.dumps(found, ensure_ascii=False).encode("utf-8")
        elif text is raw:
            text.encode("utf-8")
    except UnicodeEncodeError:
        raise GateError(f"{source}: it holds half a character (a lone surrogate)") from None
    except (ValueError, RecursionError) as error:
        raise GateError(f"{source} is no JSON: {error}") from error
    return found


def load_toml(raw: bytes | str, source: str) -> dict[str, Any]:
    """Return the content of a TOML text.

    Args:
        raw: the text, or its bytes in UTF-8.
        source: name of the text in errors, such as the path of its file.

    Raises:
        GateError: the text is no TOML or not UTF-8, has more than `MOST_BYTES` characters, is nested too
            deeply, has a number of too many digits, or gives a key twice.
    """
    text = decoded(raw, source)
    if len(text) > MOST_BYTES:
        raise too_large(source, len(text), MOST_BYTES)
    _check_toml(text, source)
    try:
        found = tomllib.loads(text)
    # A key or table that is given twice raises ValueError.
    except (ValueError, RecursionError) as error:
        raise GateError(f"{source} is no valid TOML: {error}") from error
    check_depth(found, source)
    return found


def check_depth(content: Any, source: str) -> None:
    """Raise GateError if the lists and mappings of a parsed text are nested more than `MOST_DEPTH` levels
    deep; `source` names the text in the message."""
    level: list[Any] = [content]
    for _ in range(MOST_DEPTH + 1):
        level = [one for part in level for one in _parts(part)]
        if not level:
            return
    raise too_deep(source)


def too_large(source: str, size: int, most: int) -> GateError:
    """Return the error for a text or file, named `source`, of `size` bytes if `most` bytes are allowed."""
    return GateError(f"{source}: {size / 1e6:.1f} MB; such a file has up to {most / 1e6:g} MB")


def too_deep(source: str, line: int = 0) -> GateError:
    """Return the error for a text, named `source`, that is nested too deeply, at a line number (0:
    unknown)."""
    where = f"line {line}: " if line else ""
    return GateError(
        f"{source}: {where}lists and mappings are within each other more than {MOST_DEPTH} deep; "
        "no file that this program reads is"
    )


def too_many(source: str, most: int) -> GateError:
    """Return the error for a text, named `source`, with more than `most` values."""
    return GateError(
        f"{source}: it holds more than {most:,} values, references counted as often as they are used"
    )


def too_long(source: str, line: int = 0) -> GateError:
    """Return the error for a number of too many digits in a text, named `source`, at a line number (0:
    unknown)."""
    where = f"line {line} has" if line else "it has"
    return GateError(f"{source}: {where} a number of more than {MOST_DIGITS} digits")


def _parts(content: Any) -> Iterable[Any]:
    found = content.values() if isinstance(content, dict) else content if isinstance(content, list) else ()
    return (one for one in found if isinstance(one, dict | list))


def _mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        seen: set[str] = set()
        name = next(key for key, _ in pairs if key in seen or seen.add(key))
        raise ValueError(f"the name {name[:60]!r} is given twice")
    return made


def _check_json(raw: bytes, source: str) -> None:
    """Raise GateError if the number of values, the nesting depth or the digits of a number exceed the limits.

    A text that is no JSON passes, because the parser reports the fault later.
    """
    if raw.count(b'"') > 4 * MOST_VALUES:
        raise too_many(source, MOST_VALUES)
    bare = _JSON_TEXT.sub(b"", raw)
    opened, closed = (sum(map(bare.count, some)) for some in ((b"[", b"{"), (b"]", b"}")))
    if opened > MOST_VALUES or closed > MOST_VALUES:
        raise too_many(source, MOST_VALUES)
    if bare.count(b",") > MOST_NUMBERS:
        raise too_many(source, MOST_NUMBERS)
    if opened > MOST_DEPTH:
        brackets = np.frombuffer(bare.translate(None, _BRACKETS), dtype=np.uint8)
        steps = np.where((brackets == ord("[")) | (brackets == ord("{")), 1, -1)
        if np.cumsum(steps).max() > MOST_DEPTH:
            raise too_deep(source)
    if _DIGITS.search(bare):
        raise too_long(source)


def _check_toml(text: str, source: str) -> None:
    """Raise GateError if brackets or dotted keys are nested too deeply, or a number has too many digits.

    A text that is no TOML passes, because the parser reports the fault later.
    """
    depth = dots = 0
    for found in _TOML_PARTS.finditer(text):
        kind = found.lastgroup
        if kind == "open":
            depth, dots = depth + 1, 0
        elif kind == "close":
            depth, dots = max(depth - 1, 0), 0
        elif kind == "other":
            dots = 0
        elif kind == "word":
            word = found[0]
            dots += word.count(".")
            if word[0] in "0123456789+-" and len(word) > MOST_DIGITS:
                raise too_long(source, text.count("\n", 0, found.start()) + 1)
        # Each part of a dotted key (a.b.c) makes a nested mapping.
        if depth > MOST_DEPTH or dots > MOST_DEPTH:
            raise too_deep(source, text.count("\n", 0, found.start()) + 1)
