"""Progress bar for files that take a while to read."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

LARGE = 100_000_000  # size in bytes from which a file gets a progress bar; reading it takes about a second


@contextmanager
def reading_progress(path: Path) -> Iterator[Callable[[int], None]]:
    """Provide a progress bar for the block: a function that takes the number of bytes read so far. The
    function does nothing for small files, without a terminal, or without the package rich."""
    size = path.stat().st_size
    if size < LARGE or not sys.stderr.isatty():
        yield lambda position: None
        return
    try:
        # rich comes with the command line, and is not needed for reading.
        from rich.console import Console
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
