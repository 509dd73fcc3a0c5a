"""The panel's folder, which keeps all data of the panel: no request can name a file outside it."""

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
STORE = "zarr.json"  # file that marks a folder as the store of a study
_LONGEST_MESSAGE = 1500  # largest length of a message for a page, characters: about ten lines
# Age of a folder's last change from which its list is kept, ns. Some file systems count modification times in
# steps of 2 s, so a second change within this time may not show.
_SETTLED = 2e9


class FolderError(ValueError):
    """Refusal of a name that is not the name of a file that the panel may use, or of a missing file."""


class File(NamedTuple):
    """A file of the folder: name, time of its last change (s since 1970), and size (bytes)."""

    name: str
    changed: float
    size: int


class _Content(NamedTuple):
    """Content of a folder: names of its folders and files. `changed` is its modification time [ns] when it
    was listed."""

    changed: int
    folders: list[str]
    files: list[tuple[str, bool]]  # pairs: name, and True for a link


class Folder:
    """The panel's folder. Its files are named by their path relative to it, with slashes."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self._known: dict[str, _Content] = {}  # content of folders that did not change lately, by name
        self._shared = Shared()

    def path(self, name: str) -> Path:
        """Return the path of a named file of the folder, existing or not.

        Raises:
            FolderError: the name is not a relative path of visible names; it leads out of the folder by dots
                or a link; it is the name of a pipe, socket or device, which could block whoever opens it; or
                it lies in the store of a study, or more than `MOST_LEVELS` folders deep.
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
        """Return the name of a file in the folder, the reverse of `path`.

        Raises ValueError for a file outside the folder.
        """
        return path.resolve().relative_to(self.root).as_posix()

    def files(self, *suffixes: str) -> list[File]:
        """Return all files of the folder whose names end with one of `suffixes` (".nc"), the newest first.

        Hidden files, the content of linked folders, and links that lead out of the folder are left out. Only
        zarr.json is listed of a study's store.
        """
        return [*self._shared(suffixes, lambda: self._files(suffixes))]

    def _files(self, suffixes: tuple[str, ...]) -> list[File]:
        found = []
        for name, link in self._walk(""):
            path = f"{self.root}/{name}"
            wanted = os.path.splitext(name)[1] in suffixes and len(name) <= LONGEST_NAME
            if wanted and not (link and self._leads_out(path)):
                with suppress(OSError):  # the file was deleted in the meantime, or is a link to itself
                    status = os.stat(path)
                    if stat.S_ISREG(status.st_mode):
                        found.append(File(name, status.st_mtime, status.st_size))
        return sorted(found, key=lambda one: (one.changed, one.name), reverse=True)

    def _leads_out(self, path: str) -> bool:
        return not Path(os.path.realpath(path)).is_relative_to(self.root)

    def _walk(self, inside: str) -> Iterator[tuple[str, bool]]:
        """Yield pairs of the name of each file below a folder, and True if the file is a link.

        `inside` is the folder: "" or a name that ends with a slash.
        """
        # `path` refuses all names of files below this folder.
        if len(inside) > LONGEST_NAME or inside.count("/") > MOST_LEVELS:
            return
        with suppress(OSError):
            content = self._content(inside)
            # The files of a study's store are not the user's files.
            if inside and (STORE, False) in content.files:
                yield inside + STORE, False
                return
            for name, link in content.files:
                yield inside + name, link
            for name in content.folders:
                yield from self._walk(f"{inside}{name}/")

    def _content(self, inside: str) -> _Content:
        """Return the content of the subfolder `inside`, "" for the panel's folder itself.

        The folder is listed again only if it has changed, because many pages ask for lists of hundreds of
        runs.
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
        """Return a message for a page, without this machine's paths.

        Paths in the panel's folder become relative to it; of other paths only the file's name stays. The
        middle of a message above `_LONGEST_MESSAGE` characters is left out.
        """
        text = text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), "the panel's folder")
        if len(text) > _LONGEST_MESSAGE:  # a message may quote a value as long as a file
            text = f"{text[: _LONGEST_MESSAGE - 300]} ... {text[-300:]}"
        return _ABSOLUTE.sub(r"\1", text)
