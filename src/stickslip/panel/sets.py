"""Parameter sets that the pages offer: those of the package, and those saved in the panel's folder."""

from __future__ import annotations

import os
from functools import cache, lru_cache
from pathlib import Path

from ..history.walking import SETS
from ..parameters import ParameterSetError, available_sets, load_set
from ..physics.actuator import Actuator, load_actuator
from ..quantities.registry import nothing_run
from ..quantities.units import QuantityError
from .folder import Folder, FolderError

MOST = 50  # largest number of saved sets on offer, the newest ones


class Sets:
    """Parameter sets by name: those of the package, and those saved in a folder (None: no folder).

    The name of a saved set is that of its file, "parameters/NAME.toml".
    """

    def __init__(self, folder: Folder | None = None) -> None:
        self._folder = folder

    def offered(self) -> dict[str, tuple[str, Actuator]]:
        """Return title and actuator of each actuator's set by name: the package's, and the newest `MOST`
        saved ones.

        Files that cannot be read are left out.
        """
        found = {name: _published(name) for name in available_sets() if load_set(name).kind == "actuator"}
        for name in self._saved():
            try:
                found[name] = self._read(name)
            except (ParameterSetError, QuantityError, OSError):
                continue
        return found

    def actuator(self, name: str) -> Actuator:
        """Return the actuator of a set, from memory if its file has not changed.

        Reading a set takes longer than simulating its actuator.

        Raises:
            QuantityError: the set does not exist, or cannot be read.
        """
        if name in available_sets():
            return _published(name)[1]
        if self._folder is None or not name.startswith(f"{SETS}/"):
            raise QuantityError(
                f"set = {name[:60]!r} is none of those that come with the package or were saved"
            )
        try:
            return self._read(name)[1]
        except (ParameterSetError, FolderError, OSError) as error:
            raise QuantityError(f"set = {name[:60]!r}: {self._folder.told(str(error))}") from error

    def _saved(self) -> list[str]:
        if self._folder is None:
            return []
        return [name for name, *_ in self._folder.files(".toml") if name.startswith(f"{SETS}/")][:MOST]

    def _read(self, name: str) -> tuple[str, Actuator]:
        assert self._folder is not None
        path = self._folder.path(name)
        if not path.is_file():
            raise ParameterSetError("there is no such file")
        status = path.stat()
        with nothing_run():
            return _of_file(path, (status.st_mtime_ns, status.st_size))


@cache
def _published(name: str) -> tuple[str, Actuator]:
    return load_set(name).title, load_actuator(name)


@lru_cache(maxsize=2 * MOST)
def _of_file(path: Path, changed: tuple[int, int]) -> tuple[str, Actuator]:
    del changed  # a part of the cache's key only: a changed file is read again
    return load_set(os.fspath(path)).title, load_actuator(path)


PACKAGE = Sets()
