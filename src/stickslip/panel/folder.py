"""The one folder that the panel reads and writes: nothing outside it can be named, reached or shown."""

from __future__ import annotations

import os
import re
import stat
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ..gate.errors import GateError
from ..gate.paths import LONGEST_NAME, inside, is_name
from ..history.walking import MOST_LEVELS
from .sharing import Shared

_ABSOLUTE = re.compile(r"(?<![\w.)\]])(?:[A-Za-z]:)?[/\\](?:[^\s'\":;,/\\]+[/\\])+([^\s'\":;,/\\]*)")
STORE = "zarr.json"  # a folder with this file is a study's store
_LONGEST_MESSAGE = 1500  # characters, about ten lines of a page
# ns: some file systems count modification times in steps of 2 s. A folder that changed within this time is
# listed again, because a second change may not show.
_SETTLED = 2e9


class FolderError(ValueError):
    """Name that is not a valid file name in the panel's folder."""


class File(NamedTuple):
    """A file of the folder: name, time of its last change (s since 1970), size (bytes)."""

    name: str
    changed: float
    size: int


class _Content(NamedTuple):
    """Content of a folder, and its modification time [ns] when it was read."""

    changed: int
    folders: list[str]
    files: list[tuple[str, bool]]  # names, and whether they are links


class Folder:
    """A folder and its files, named by their relative path with slashes."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self._known: dict[str, _Content] = {}  # content of folders that have not changed lately
        self._shared = Shared()

    def path(self, name: str) -> Path:
        """Return the path of a named file, existing or not.

        Raises:
            FolderError: the name leads out of the folder, by dots or by a link; it is not a plain name; it
                names a pipe, socket or device, which may block whoever opens it; or the file would not be
                listed, because it lies in a study's store or too deep.
        """
        try:
            found = inside(self.root, name, "the panel's folder")
        except GateError as error:
            raise FolderError(str(error)) from error
        *above, _ = name.split("/")
        if len(above) > MOST_LEVELS:
            raise FolderError(f"{name[:60]!r} is more than {MOST_LEVELS} folders deep: choose another name")
        for i in range(len(above)):
            if (self.root.joinpath(*above[: i + 1]) / STORE).exists():
                raise FolderError(f"{name[:60]!r} is in the store of a study: choose another folder")
        return found

    def name(self, path: Path) -> str:
        """Return the name of a file in the folder: its path relative to the folder, with slashes."""
        return path.resolve().relative_to(self.root).as_posix()

    def files(self, *suffixes: str) -> list[File]:
        """Return all files with these endings, the newest first.

        Links that lead out of the folder and files whose names `path` refuses are left out.
        """
        return [*self._shared(suffixes, lambda: self._files(suffixes))]

    def _files(self, suffixes: tuple[str, ...]) -> list[File]:
        found = []
        for name, link in self._walk(""):
            path = f"{self.root}/{name}"
            wanted = os.path.splitext(name)[1] in suffixes and len(name) <= LONGEST_NAME
            if wanted and not (link and self._leads_out(path)):
                with suppress(OSError):  # the file was just deleted, or is a link to itself
                    status = os.stat(path)
                    if stat.S_ISREG(status.st_mode):
                        found.append(File(name, status.st_mtime, status.st_size))
        return sorted(found, key=lambda one: (one.changed, one.name), reverse=True)

    def _leads_out(self, path: str) -> bool:
        return not Path(os.path.realpath(path)).is_relative_to(self.root)

    def _walk(self, inside: str) -> Iterator[tuple[str, bool]]:
        """Yield the name of each file below a folder ("" or a path that ends with a slash), and True for a
        link."""
        if len(inside) > LONGEST_NAME:  # `path` refuses all names below this folder
            return
        with suppress(OSError):
            content = self._content(inside)
            if inside and (STORE, False) in content.files:  # its chunks are not the user's files
                yield inside + STORE, False
                return
            for name, link in content.files:
                yield inside + name, link
            for name in content.folders:
                yield from self._walk(f"{inside}{name}/")

    def _content(self, inside: str) -> _Content:
        """Return the content of the subfolder `inside` ("" for the folder itself).

        It is listed again only if it has changed: many pages ask for lists of hundreds of runs.
        """
        path, now = f"{self.root}/{inside}", time.time_ns()
        changed = os.stat(path).st_mtime_ns
        known = self._known.get(inside)
        if known is not None and known.changed == changed:
            return known
        with os.scandir(path) as entries:
            shown = [one for one in entries if is_name(one.name)]
        folders = [one.name for one in shown if one.is_dir(follow_symlinks=False)]
        files = [(one.name, one.is_symlink()) for one in shown if not one.is_dir(follow_symlinks=False)]
        content = _Content(changed, folders, files)
        if now - changed > _SETTLED:
            self._known[inside] = content
        return content

    def told(self, text: str) -> str:
        """Return a message for a page without this machine's paths: they become relative to the folder.

        Of paths elsewhere only the file's name stays. The middle of a very long message is left out.
        """
        text = text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), "the panel's folder")
        if len(text) > _LONGEST_MESSAGE:  # it may quote names and values as long as a file
            text = f"{text[: _LONGEST_MESSAGE - 300]} ... {text[-300:]}"
        return _ABSOLUTE.sub(r"\1", text)
