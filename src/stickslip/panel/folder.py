"""The one folder that the panel reads and writes: nothing outside it can be named, reached or told."""

from __future__ import annotations

import os
import re
from pathlib import Path

_ABSOLUTE = re.compile(r"(?<![\w.)\]])(?:[A-Za-z]:)?[/\\](?:[^\s'\":;,/\\]+[/\\])+([^\s'\":;,/\\]*)")


class FolderError(ValueError):
    """A name that is none of a file in the panel's folder."""


class Folder:
    """A folder and the files in it, named by their path inside it with slashes."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()

    def path(self, name: str) -> Path:
        """Where the file of that name is, or would be.

        Raises:
            FolderError: the name leads out of the folder, by dots or by a link, or is no plain name.
        """
        parts = name.split("/")
        if not name or len(name) > 400 or not name.isprintable() or any(bad in name for bad in "\\:"):
            raise FolderError(f"{name[:60]!r} is no name of a file in the panel's folder")
        if any(part in ("", ".", "..") or part.startswith(".") for part in parts):
            raise FolderError(f"{name[:60]!r} is no name of a file in the panel's folder")
        found = Path(os.path.realpath(self.root.joinpath(*parts)))
        if not found.is_relative_to(self.root):
            raise FolderError(f"{name[:60]!r} leads out of the panel's folder")
        return found

    def name(self, path: Path) -> str:
        """The name of a file in the folder."""
        return path.resolve().relative_to(self.root).as_posix()

    def files(self, *suffixes: str) -> list[str]:
        """Names of all files with these endings, the newest first; links that lead out are left out."""
        found = []
        for folder, folders, names in os.walk(self.root):
            folders[:] = [one for one in folders if not one.startswith(".")]
            for name in names:
                path = Path(folder, name)
                if path.suffix in suffixes and not name.startswith("."):
                    real = Path(os.path.realpath(path))
                    if real.is_relative_to(self.root) and real.is_file():
                        found.append((path.stat().st_mtime, path.relative_to(self.root).as_posix()))
        return [name for _, name in sorted(found, reverse=True)]

    def told(self, text: str) -> str:
        """A message without the paths of this machine: those in the folder are named as inside it."""
        text = text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), "the panel's folder")
        return _ABSOLUTE.sub(r"\1", text)
