"""Functions of a file that end the process in which they run, or its patience."""

from __future__ import annotations

import mmap
import os
import sys
import time
from pathlib import Path


class Odd(Exception):
    """An error that cannot be sent."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(first)


def size(path: Path) -> int:
    return path.stat().st_size


def slow_size(path: Path) -> int:
    time.sleep(0.1)
    return path.stat().st_size


def imported(path: Path, name: str) -> bool:
    return name in sys.modules


def compute(path: Path) -> None:
    while True:
        pass


def allocate(path: Path) -> bytearray:
    return bytearray(2**30)


def refused(path: Path) -> None:
    raise MemoryError


def end(path: Path, number: int) -> None:
    os.kill(os.getpid(), number)
    time.sleep(10.0)


def leave(path: Path) -> None:
    os._exit(3)


def missing(path: Path) -> None:
    raise FileNotFoundError(2, "gone", str(path))


def odd(path: Path) -> None:
    raise Odd(5, 6)


def process(path: Path) -> int:
    return os.getpid()


def cut(path: Path) -> int:
    """Map a file and cut it before reading, as whoever writes it anew does."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        os.truncate(path, 0)
        return content[0]
