"""User's functions and files that a study needs and sends to its workers; hashes identify their content."""

from __future__ import annotations

import hashlib
import importlib
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..quantities import registry
from ..quantities.registry import RegistryError, allowed_file, origin, own_path, use_file


@dataclass(frozen=True)
class OwnFunction:
    """A user's function: the path of its file, its name, and the file's SHA-256 hash (`content`).

    The object can be pickled, called like the function (positional arguments only), and used by other
    processes, which import the file.
    """

    path: str
    name: str
    content: str

    def __call__(self, *arguments: Any) -> Any:
        """Call the function and return its result; the first call in a process imports (runs) its file.

        Raises RegistryError if the file cannot be imported or has no such function.
        """
        return _found(self)(*arguments)

    def __str__(self) -> str:
        return f"{Path(self.path).name}:{self.name}"


def own_function(
    given: Callable[..., Any] | str | OwnFunction, folder: str | Path | None = None
) -> OwnFunction:
    """Return a user's function in a form in which other processes can import it; its file is imported here.

    Args:
        given: the function, or its place as ``"FILE.py:NAME"``.
        folder: folder of the input file that names the function; FILE.py must lie in it, or be in use
            already. None if the user gives the place, relative to the current folder.

    Raises:
        RegistryError: the function is not at the top level of a file that other processes can import, the
            function belongs to the main script, the file is not allowed or fails, or NAME is no function.
    """
    if isinstance(given, OwnFunction):
        return given
    if isinstance(given, str):
        path, name = own_path(given)
        if not path:
            raise RegistryError(f"{given!r}: a function of your own is FILE.py:NAME")
        path = str((Path(path) if folder is None else allowed_file(path, folder)).resolve())
    else:
        name = str(getattr(given, "__qualname__", ""))
        module = sys.modules.get(str(getattr(given, "__module__", "")))
        path = str(Path(getattr(module, "__file__", None) or "").resolve()) if module else ""
        if not name.isidentifier() or not path.endswith(".py") or module is sys.modules.get("__main__"):
            raise RegistryError(
                f"{name or given!r} is not a function of a file that other processes can import: put it on "
                "the top level of a file of its own, and name it FILE.py:NAME"
            )
    made = OwnFunction(path, name, content_hash(path))
    if not callable(_found(made)):
        raise RegistryError(f"{made} is no function")
    return made


def content_hash(path: str | Path) -> str:
    """Return the SHA-256 hash of a file in hexadecimal digits; raises RegistryError if it cannot be read."""
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise RegistryError(f"{path} cannot be read: {error.strerror}") from error


# Paths on this machine of the files that other processes have sent to this one, by hash of the content.
_PLACES: dict[str, str] = {}


def _found(function: OwnFunction) -> Any:
    module = use_file(_PLACES.get(function.content, function.path))
    try:
        return getattr(module, function.name)
    except AttributeError:
        raise RegistryError(f"{function.path} has no function {function.name!r}") from None


def files_of(paths: Iterable[str]) -> list[tuple[str, bytes]]:
    """Read files that are to be sent to workers; return pairs of path and content (bytes), each path once.

    Raises OSError if a file cannot be read.
    """
    return [(path, Path(path).read_bytes()) for path in dict.fromkeys(paths)]


def law_files(model: Any) -> list[str]:
    """Return the paths of the user's files that a worker must import.

    They are the file that defines the friction law of `model`, if it is a user's law, and all files that this
    process has run by `use_file`. `model` is an actuator, or None.
    """
    law = origin(type(getattr(model, "friction", None)))
    return [*([law] if law.endswith(".py") else []), *registry.used_files()]


def put_in_use(files: Iterable[tuple[str, bytes]]) -> None:
    """Import files that were sent from another process.

    If the same path on this machine has the same content, that file is imported; otherwise the content is
    written to a new temporary folder, which stays, and imported from there. `OwnFunction` finds files by
    their content.

    Args:
        files: pairs of path and content.

    Raises:
        RegistryError: a file cannot be imported.
    """
    for path, text in files:
        content = hashlib.sha256(text).hexdigest()
        path = _PLACES.get(content, path)
        if not (Path(path).is_file() and content_hash(path) == content):
            folder = tempfile.mkdtemp(prefix="stickslip-own-")  # no other user of the machine can write there
            path = str(Path(folder, Path(path).name))
            Path(path).write_bytes(text)
        _PLACES[content] = path
        importlib.invalidate_caches()
        use_file(path)
