"""Write a folder that appears complete or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .source import ExportError


@contextmanager
def whole(out: str | os.PathLike[str]) -> Iterator[Path]:
    """Provide a context with a new temporary folder beside `out`, which is renamed to `out` at the end.

    If an error occurs in the context, the temporary folder is deleted and `out` does not appear. Missing
    parent folders of `out` are made and stay.

    Raises:
        ExportError: `out` is no path, exists already, or cannot be made.
        OSError: a file in the folder cannot be written; the error names `out`.
    """
    if not isinstance(out, str | os.PathLike):
        raise ExportError(f"out = {out!r:.60} must be the path of the folder to make")
    target = Path(out)
    if target.exists() or target.is_symlink():
        raise ExportError(f"{target} exists already; nothing was written")
    try:
        target.absolute().parent.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.absolute().parent))
    except OSError as error:
        raise ExportError(f"{target} cannot be written: {error.strerror}") from error
    try:
        yield made
        made.chmod(0o755)
        made.rename(target)
    except BaseException as error:
        shutil.rmtree(made, ignore_errors=True)
        # The error of a full disk names no path, or the path of the temporary folder; `out` is named instead.
        if isinstance(error, OSError) and error.errno is not None:
            raise OSError(error.errno, error.strerror, str(target)) from error
        raise
