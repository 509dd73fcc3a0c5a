"""Progress bar for files that take a while to read."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

LARGE = 100_000_000  # size in bytes from which a file gets a bar; reading it takes about a second


@contextmanager
def reading_progress(path: Path) -> Iterator[Callable[[int], None]]:
    """Provide a function that takes the number of bytes read so far and updates a progress bar; it does
    nothing for small files, without a terminal, or without the package rich."""
    size = path.stat().st_size
    if size < LARGE or not sys.stderr.isatty():
        yield lambda position: None
        return
    try:
        from rich.console import Console  # comes with the command line, not needed for reading
        from rich.progress import (
            BarColumn,
            DownloadColumn,
            Progress,
            TimeRemainingColumn,
            TransferSpeedColumn,
        )
    except ImportError:
        yield lambda position: None
        return
    columns = (
        "{task.description}",
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(f"Reading {path.name}", total=size)
        yield lambda position: bar.update(task, completed=position)
