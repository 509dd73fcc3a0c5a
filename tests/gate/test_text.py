"""Hostile text is refused in one sentence, at once, and in little memory; ordinary text is read as usual."""

from __future__ import annotations

import gzip
import json
import math
import os
import random
import subprocess
import sys
import time
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml

from stickslip.gate.errors import GateError
from stickslip.gate.text import (
    MOST_BYTES,
    MOST_DEPTH,
    MOST_VALUES,
    load_json,
    load_toml,
    read_file,
    read_json,
    unzipped,
)
from stickslip.gate.yaml_text import load_yaml

PATIENCE = 3.0  # s of computing for any text; most take milliseconds
MEMORY = 300e6  # bytes
ROOT = Path(__file__).parents[2]

YAML = {
    "brackets": ("x: " + "[" * 50_000 + "]" * 50_000, "deep"),
    "dashes": ("- " * 400_000, "deep"),
    "indented": ("\n".join(" " * n + "a:" for n in range(1300)), "deep"),
    "flow mappings": ("{a: " * 100_000, "deep"),
    "merges": (
        "a0: &a0 {" + ", ".join(f"k{n}: 1" for n in range(10)) + "}\n"
        + "".join(f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 10)}]}}\n" for n in range(1, 9)),
        "more than 100,000 values",
    ),
    "references": (
        "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
        + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12)),
        "more than 100,000 values",
    ),
    "many values": ("x: [" + "1," * 400_000 + "]", "more than 100,000 values"),
    "itself": ("a: &a [*a]", "line 1: '*a' refers to itself"),
    "nothing": ("a: 1\nb: *c", "line 2: '*c' refers to nothing"),
    "base 60": ("x: 1" + ":59" * 300_000, "line 1 has a number of more than 100 digits"),
    "digits": ("x: " + "9" * 900_000, "line 1 has a number of more than 100 digits"),
    "hexadecimal": ("x: 0x" + "f" * 900_000, "digits"),
    "tag lines": ("".join(f"%TAG !a{n}! x\n" for n in range(60_000)) + "--- x", "'%'"),
    "a tag": ("x: !!python/object/apply:os.system [ls]", "line 1: the tag 'tag:yaml.org"),
    "bad number": ("x: !!int ''", "tag"),
    "twice": ("a: 1\nb: 2\na: 3", "line 3: the key 'a' is given twice"),
    "a list as a key": ("? [1]\n: 2", "line 1: a key is no text"),
    "two documents": ("a: 1\n---\nb: 2", "line 2: a second document"),
    "no such day": ("x: 2026-99-99", "month"),
    "merge of a number": ("a: {<<: 5}", "'<<' takes a mapping"),
    "half a letter": ('x: "\\ud800"', "no YAML"),
    "no YAML": ("x: 'a", "no YAML"),
    "large": ("#" * (MOST_BYTES + 1), "1.0 MB; such a file has up to 1 MB"),
}  # fmt: skip

JSON = {
    "brackets": ("[" * 100_000, "deep"),
    "nested": ("[" * 500 + "]" * 500, "deep"),
    "objects": ('{"a":' * 100_000, "deep"),
    "digits": ("[" + "9" * 5000 + "]", "digits"),
    "many": ("[" + "[]," * 2_000_000 + "[]]", "more than 1,000,000 values"),
    "quotes": ('"' * 5_000_000, "values"),
    "escaped quotes": ('"' + '\\"' * 1_900_000, "no JSON"),
    "twice": ('{"a": 1, "b": {"c": 1, "c": 2}}', "the name 'c' is given twice"),
    "half a letter": ('{"a": "\\ud800"}', "half a character"),
    "cut": ('{"a": [1, 2', "no JSON"),
}

TOML = {
    "arrays": ("a = " + "[" * 100_000, "line 1: lists and mappings are within each other"),
    "inline tables": ("a = " + "{a = " * 100_000, "deep"),
    "a dotted key": ("a." * 400_000 + "a = 1", "deep"),
    "a dotted header": ("[" + "a." * 400_000 + "a]", "deep"),
    "quoted parts": ('"a".' * 100_000 + "a = 1", "deep"),
    "tables in tables": ("".join(f"[[{'.'.join(['a'] * n)}]]\n" for n in range(1, 70)), "deep"),
    "digits": ("a = " + "9" * 900_000, "digits"),
    "hexadecimal": ("a = 0x" + "f" * 90_000, "digits"),
    "quotes": ("a = '''" + "'" * 900_000, "no valid TOML"),
    "an open text": ('a = """' + "a\\\n" * 200_000, "no valid TOML"),
    "large": ("a = 1\n" * 8_000_000, "48.0 MB; such a file has up to 1 MB"),
}


@pytest.mark.parametrize(
    ("load", "text", "words"),
    [
        pytest.param(load, *case, id=f"{load.__name__} {name}")
        for load, cases in ((load_yaml, YAML), (load_json, JSON), (load_toml, TOML))
        for name, case in cases.items()
    ],
)
def test_hostile_text_is_refused_at_once_in_one_line(load: Any, text: str, words: str) -> None:
    began = time.process_time()
    with pytest.raises(GateError) as caught:
        load(text.encode(), "some/file")
    assert time.process_time() - began < PATIENCE
    said = str(caught.value)
    assert said.startswith("some/file")
    assert words in said
    assert "\n" not in said
    assert len(said) < 400


def test_the_largest_texts_that_pass_stay_in_bounded_memory() -> None:
    code = f"""
from stickslip.gate.text import load_json, load_toml
from stickslip.gate.yaml_text import load_yaml
import resource
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
load_yaml("x: [" + "1, " * 90_000 + "]", "")
load_json("[" + ", ".join(['{{"a": 1}}'] * ({MOST_VALUES} // 2 - 1)) + "]", "")
load_toml("".join(f"[a{{n}}]\\n" for n in range(90_000)), "")
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) * 1e3 < MEMORY


def test_ordinary_files_are_read_as_the_libraries_read_them() -> None:
    files = [*ROOT.glob("src/**/examples/*.yaml")]
    assert len(files) > 10
    for file in files:
        assert load_yaml(file.read_bytes(), str(file)) == yaml.safe_load(file.read_text("utf-8")), file
    sets = [one for one in ROOT.glob("src/**/*.toml") if one.parent.name != "templates"]
    assert len(sets) > 10
    for file in sets:
        assert load_toml(file.read_bytes(), str(file)) == tomllib.loads(file.read_text("utf-8")), file


def test_values_of_yaml() -> None:
    text = """
a: [1, -2.5, .inf, 1.0e-3, true, no, null, ~, "5", '7', 0x10, 2026-03-01, !!str 5, !  6]
b: &b {x: 1, y: 2}
c: {<<: *b, y: 3}
d: {<<: [{y: 5}, *b], z: 1}
on: 1:30
5: |
  text
e: *b
"""
    found = load_yaml(text, "")
    assert found["a"][:2] == [1, -2.5]
    assert math.isinf(found["a"][2])
    assert found["a"][3:] == [1e-3, True, False, None, None, "5", "7", 16, date(2026, 3, 1), "5", "6"]
    assert found["c"] == {"x": 1, "y": 3}
    assert found["d"] == {"x": 1, "y": 5, "z": 1}
    assert (found["on"], found["5"], found["e"]) == ("1:30", "text\n", found["b"])
    assert load_yaml("", "") is None


def test_depth_up_to_the_limit_is_read() -> None:
    for load, head in ((load_yaml, ""), (load_json, "")):
        assert load(head + "[" * MOST_DEPTH + "]" * MOST_DEPTH, "")
        with pytest.raises(GateError, match="deep"):
            load(head + "[" * (MOST_DEPTH + 1) + "]" * (MOST_DEPTH + 1), "")
    brackets = '{"a": "' + "[" * 1000 + '\\"{", "b": [1e400, NaN]}'
    assert load_json(brackets, "")["a"] == "[" * 1000 + '"{'
    assert load_toml('a = "' + "[" * 1000 + '"  # ' + "[" * 1000 + "\nb = [1.5, 2.5]", "")["b"] == [1.5, 2.5]


def test_encodings_are_said(tmp_path: Path) -> None:
    for load in (load_yaml, load_json, load_toml):
        with pytest.raises(GateError, match=r"x: it is in UTF-16, or no text at all; save it as UTF-8"):
            load('a = "ß"'.encode("utf-16"), "x")
        with pytest.raises(GateError, match="line 2 has a letter that is not in UTF-8"):
            load("\n# Größe".encode("latin-1"), "x")
    assert load_json(b'\xef\xbb\xbf{"a": 1}', "x") == {"a": 1}
    assert load_toml(b"\xef\xbb\xbfa = 1\r\nb = 2", "x") == {"a": 1, "b": 2}


def test_only_plain_files_of_bounded_size_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "."):
        with pytest.raises(GateError, match="no plain file"):
            read_file(tmp_path / name)
    (tmp_path / "large").write_bytes(b"1" * 2000)
    with pytest.raises(GateError, match=r"large: 0\.0 MB; such a file has up to 0\.001 MB"):
        read_file(tmp_path / "large", most=1000)
    with pytest.raises(FileNotFoundError):
        read_json(tmp_path / "none")
    bomb = gzip.compress(b"1" * 1_000_000)
    with pytest.raises(GateError, match=r"b: its content has more than 0\.001 MB"):
        unzipped(bomb, "b", most=1000)
    for damaged in (bomb[:50], b"no", bomb[:20] + b"\xff" * 30 + bomb[50:]):
        with pytest.raises(GateError, match="damaged gzip data"):
            unzipped(damaged, "b")


def test_random_texts_raise_nothing_else() -> None:
    """2,000 texts of what YAML, JSON and TOML are made of, and of random bytes."""
    draw = random.Random(5)
    parts = [*"[]{}:,-?&*!|>'\"%@`#=.\n \t\\", "a", "&a ", "*a", "<<: ", "- ", "1", "1e5", "!!int ", "0x"]
    parts += [
        "'''",
        '"""',
        "[[",
        "---\n",
        "...",
        "\\u",
        "\ud800",
        "é",
        "2026-01-01",
        "T1:00:00+99:99",
        "\x07",
    ]
    read = 0
    for number in range(2000):
        if number % 4:
            raw = "".join(draw.choices(parts, k=draw.randint(1, 40))).encode("utf-8", "surrogatepass")
        else:
            raw = draw.randbytes(draw.randint(1, 60))
        for load in (load_yaml, load_json, load_toml):
            try:
                json.dumps(load(raw, "x"), default=str)
                read += 1
            except GateError:
                pass
    assert read > 100
