"""Names from outside lead to paths in one folder, or are refused."""

from __future__ import annotations

import os
import random
import socket
from pathlib import Path

import pytest

from stickslip.gate.errors import GateError
from stickslip.gate.paths import LONGEST_NAME, inside


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder with files and links, and a secret beside it."""
    (tmp_path / "secret.txt").write_text("secret")
    root = tmp_path / "lab"
    (root / "sub").mkdir(parents=True)
    (root / "a.csv").write_text("1")
    (root / "sub" / "b c.csv").write_text("2")
    (root / "out.txt").symlink_to(tmp_path / "secret.txt")
    (root / "up").symlink_to(tmp_path)
    (root / "in.csv").symlink_to(root / "a.csv")
    (root / "loop").symlink_to(root / "loop")
    os.mkfifo(root / "pipe")
    with socket.socket(socket.AF_UNIX) as one:
        before = Path.cwd()
        os.chdir(root)  # the name of a socket has up to 100 bytes
        one.bind("socket")
        os.chdir(before)
    (root / "null").symlink_to("/dev/null")
    return root


def test_names_in_the_folder_are_paths_with_links_resolved(lab: Path) -> None:
    assert inside(lab, "a.csv") == (lab / "a.csv").resolve()
    assert inside(lab, "sub/b c.csv").read_text() == "2"
    assert inside(lab, "in.csv") == (lab / "a.csv").resolve()
    assert inside(lab, "sub").is_dir()
    assert inside(lab, "new/Größe 5.nc") == lab.resolve() / "new" / "Größe 5.nc"
    assert inside(lab, "a.csv/b") == lab.resolve() / "a.csv" / "b"  # who opens it says that it is not there


@pytest.mark.parametrize(
    ("name", "words"),
    [
        *((one, "is no name of a file in the lab") for one in (
            "", ".", "..", "../secret.txt", "sub/../../secret.txt", "/etc/passwd", "//etc/passwd", "sub//b",
            "sub/", ".hidden", "sub/.hidden", "C:\\x", "sub\\b", "a:b", "a\nb", "a\0b", "\ud800", "a\u202eb",
            "x" * (LONGEST_NAME + 1), "x" * 300,
        )),
        *((one, "leads out of the lab") for one in ("out.txt", "up/secret.txt", "up", "up/lab2/x", "null")),
        *((one, "is no plain file") for one in ("pipe", "socket")),
        ("loop", "lab"),
    ],
)  # fmt: skip
def test_other_names_are_refused_in_one_line(lab: Path, name: str, words: str) -> None:
    with pytest.raises(GateError) as caught:
        inside(lab, name, "the lab")
    assert words in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 200


def test_random_names_lead_nowhere_else(lab: Path) -> None:
    """3,000 names of what paths are made of: a path in the folder, or a GateError."""
    draw, found = random.Random(8), 0
    parts = [
        "..",
        ".",
        "/",
        "//",
        "sub",
        "up",
        "a.csv",
        "out.txt",
        "\\",
        "\0",
        "~",
        "%2e%2e",
        "lab",
        "é",
        "é",
        " ",
    ]
    for _ in range(3000):
        name = "".join(draw.choices(parts, k=draw.randint(1, 6)))
        try:
            assert inside(lab, name).is_relative_to(lab.resolve())
            found += 1
        except GateError:
            pass
    assert found > 100
