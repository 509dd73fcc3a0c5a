"""Registry of friction laws, waveforms, sensors, rigs and so on by name.

An object is registered where it is defined (`register_law`, `waveform.signal.signal_record`, ...). The
package's own objects are found by importing the modules of their sub-package. Objects of other installed
packages are found by entry points, in the groups "stickslip.laws", "stickslip.waveforms" and so on. An object
in a user's own file has the name ``path.py:Name``, and also the name ``Name`` once the file has been run
(`use_file`).

A user's file is run only if it is named: by the user, on the command line or in Python, or by an input file
or a parameter set in the same folder or above. A file in another folder is run only if the user has allowed
it (`use_file`), and no new file is run within `nothing_run`. Results, fits and recordings contain the name
and the origin of each object; reading them never runs a user's file.
"""

from __future__ import annotations

import hashlib
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path, PurePath
from pkgutil import iter_modules
from types import ModuleType
from typing import Any, TypeVar

from ..gate.errors import GateError
from ..gate.paths import inside
from .records import did_you_mean
from .units import QuantityError

T = TypeVar("T")

_PACKAGE = __name__.partition(".")[0]
# Functions that register a user's own object of some kinds; of all others, `add` of the registry does.
_REGISTERING = {"law": "ss.friction.register", "reader": "stickslip.recording.readers.source.add_format"}
_USING = threading.RLock()
_USED: dict[str, tuple[str, ModuleType]] = {}  # users' files by path: hash of the content, and module
_RUNS: ContextVar[bool] = ContextVar("runs", default=True)  # False in the context `nothing_run`


class RegistryError(QuantityError):
    """Error: a name is unknown (the message lists those known) or ambiguous, or a user's file is unusable."""


class Kind:
    """Registry of all objects of one kind, such as friction laws, by name.

    Args:
        noun: name of the kind in messages, and its key in results.
        plural: name of several, and of the entry-point group "stickslip.PLURAL".
        rooms: where the package defines such objects: "module", "folder" for all modules in a folder,
            "folder.*" for all packages in it, or "folder.*.module" for one module of each package.
    """

    def __init__(self, noun: str, plural: str, *rooms: str) -> None:
        self.noun, self.plural, self._rooms = noun, plural, tuple(f"{_PACKAGE}.{room}" for room in rooms)
        self._things: dict[str, dict[str, Any]] = {}  # objects by name and, "" for the package's, by file
        self._called: dict[Any, str] = {}  # registered names of classes that differ from __name__

    def add(self, thing: T, name: str = "", maker: Any = None) -> T:
        """Register an object and return it; usable as a decorator of classes.

        An object of the same name from the same place is replaced.

        Args:
            thing: the object.
            name: name under which it is found; by default its `__name__`.
            maker: function or class whose file counts as the origin of the object; by default the object.
        """
        place = origin(thing if maker is None else maker)
        if name and isinstance(thing, type):
            self._called[thing] = name
        self._things.setdefault(name or thing.__name__, {})[place] = thing  # type: ignore[attr-defined]
        return thing

    def packaged(self) -> dict[str, Any]:
        """Return the objects that the package itself defines, by name."""
        self._import_rooms()
        return {name: of[""] for name, of in self._things.items() if "" in of}

    def names(self) -> tuple[str, ...]:
        """Return the names that `find` accepts, except ``path.py:Name``: first those of the package's own
        objects, then those of users' files and other packages."""
        return tuple(dict.fromkeys((*self.packaged(), *self._things, *self._installed())))

    def all(self) -> Iterator[tuple[str, Any]]:
        """Yield each name with its object. Ambiguous names, and objects that fail to load, are left out."""
        for name in self.names():
            try:
                yield name, self.find(name)
            except RegistryError:
                continue

    def find(self, text: str, folder: str | os.PathLike[str] | None = None) -> Any:
        """Return the object with a name; for ``path.py:Name`` the user's file is executed.

        Args:
            text: the name.
            folder: folder of the input file that contains the name, in which a user's file must be; None if
                the user gives the name directly.

        Raises:
            RegistryError: the name is unknown or ambiguous, or the user's file fails or may not be run.
        """
        path, name = own_path(text)
        if not path:
            return self._by_name(text)
        return self._of_file(Path(path) if folder is None else allowed_file(path, folder), name)

    def _of_file(self, path: Path, name: str) -> Any:
        module = use_file(path)
        place = str(path.resolve())
        there = {one: of[place] for one, of in self._things.items() if place in of}
        if name not in there and hasattr(module, name):
            how = _REGISTERING.get(self.noun, f"ss.registry.{self.plural}.add")
            raise RegistryError(f"{path}: {name} is no {self.noun} yet: call {how} in the file")
        if name not in there:
            known = f"{did_you_mean(name, there)}; it has {', '.join(there) or 'none'}"
            raise RegistryError(f"{path} has no {self.noun} {name!r}{known}")
        return there[name]

    def _by_name(self, name: str) -> Any:
        self._import_rooms()
        if name not in self._things and name in self._installed():
            self._load(self._installed()[name])
        of = self._things.get(name, {})
        if len(of) == 1:
            return next(iter(of.values()))
        if of:
            places = ", ".join(f"{place or _PACKAGE}:{name}" for place in of)
            raise RegistryError(f"{name!r} is more than one {self.noun}; say which: {places}")
        raise RegistryError(
            f"there is no {self.noun} {name!r}{did_you_mean(name, self.names())}; known are "
            f"{', '.join(self.names())}; one of your own is FILE.py:NAME"
        )

    def name_of(self, thing_type: type) -> str:
        """Return the name by which `find` finds a type in another process, with the path of a user's file."""
        name, place = thing_type.__name__, origin(thing_type)
        return f"{place}:{name}" if place.endswith(".py") and name not in self._installed() else name

    def written(self, thing_type: type) -> dict[str, str]:
        """Return the items with which results name a type, such as {"law": "LuGre"}: the kind's noun and the
        name. A type that is not the package's own also gets its `origin`, as "law_of"."""
        place = origin(thing_type)
        said = {self.noun: self._called.get(thing_type, thing_type.__name__)}
        return {**said, f"{self.noun}_of": place} if place else said

    def of_results(self, said: Any) -> Any:
        """Return the object that results name, or the only one of this name elsewhere; run no user's file.

        Args:
            said: mapping that contains the items which `written` returned.

        Raises:
            RegistryError: the object is unknown, and the user has to name the file that defines it.
            KeyError: the results name no object of this kind.
        """
        name, place = str(said[self.noun]), said.get(f"{self.noun}_of")
        if place is None:
            return self.packaged()[name] if name in self.packaged() else self._by_name(name)
        own = {where: thing for where, thing in self._things.get(name, {}).items() if where}
        if place in own:
            return own[place]
        if len(own) == 1:
            return next(iter(own.values()))
        if name in self._installed():
            return self._load(self._installed()[name])
        raise RegistryError(not_run(self.noun, name, str(place)))

    def of_client(self, said: Any) -> Any:
        """Return the type that another program of the same user names by the items `said`, which `written`
        returned there. A user's file that defines the type is run. Errors as for `of_results`, `use_file`."""
        place = str(said.get(f"{self.noun}_of", ""))
        if place.endswith(".py") and not self.installed(str(said[self.noun])):
            use_file(place)
        return self.of_results(said)

    def installed(self, name: str) -> bool:
        """Return True if another installed package provides an object with this name by an entry point."""
        return name in self._installed()

    def _import_rooms(self) -> None:
        for room in self._rooms:
            _import_room(room)

    def _installed(self) -> dict[str, EntryPoint]:
        found = _entry_points(tuple(sys.path)).select(group=f"{_PACKAGE}.{self.plural}")
        return {one.name: one for one in found}

    def _load(self, entry: EntryPoint) -> Any:
        where = f"the {self.noun} {entry.name!r} of {entry.dist.name if entry.dist else 'a package'}"
        try:
            made = entry.load()
        except Exception as error:
            raise RegistryError(f"{where} cannot be loaded: {_told(error)}") from error
        of = self._things.get(entry.name, {})
        if not of:
            raise RegistryError(f"{where} ({entry.value}) has not registered itself by that name")
        return next((thing for thing in of.values() if thing is made), next(iter(of.values())))


def not_run(noun: str, name: str, place: str) -> str:
    """Return the message that a user's own object, named in results, is unknown since its file was not run.

    `noun` is the kind of the object, such as "law", `name` its name, and `place` the user's file.
    """
    return (
        f"its {noun} {name} is of {place}, which is not run because a result names it: if you trust it, name "
        f"it yourself, stickslip --use {place} ..., or ss.registry.use_file({place!r}) in Python"
    )


def own_path(text: str) -> tuple[str, str]:
    """Return the pair of path and name of ``path.py:Name``; for any other text, ("", text)."""
    path, colon, name = text.rpartition(":")
    return (path, name) if colon and path.endswith(".py") else ("", text)


def origin(thing: Any) -> str:
    """Return the origin of a class or function: "" for the package's own, else the path of its file.

    Without a file, as at an interactive prompt, return the name of its module.
    """
    module = str(getattr(thing, "__module__", ""))
    if module.split(".")[0] == _PACKAGE:
        return ""
    file = getattr(sys.modules.get(module), "__file__", None)
    return str(Path(file).resolve()) if file else module


@contextmanager
def nothing_run() -> Iterator[None]:
    """Let `use_file` raise RegistryError for new files in this context, as while files are only listed.

    Files that were run before stay usable, and are run again if they have changed.
    """
    before = _RUNS.set(False)
    try:
        yield
    finally:
        _RUNS.reset(before)


def allowed_file(path: str, folder: str | os.PathLike[str]) -> Path:
    """Return the path of a user's Python file that an input file names.

    Args:
        path: path of the Python file, relative to the folder or absolute.
        folder: folder of the input file.

    Raises:
        RegistryError: the Python file is not in that folder, and the user has neither run nor imported it.
    """
    found = Path(folder, path)
    file = found.resolve()
    if str(file) in _USED or _imported(str(file)) is not None:
        return found
    top = Path(folder).resolve()
    own = file.relative_to(top) if Path(path).is_absolute() and file.is_relative_to(top) else PurePath(path)
    try:
        inside(folder or ".", own.as_posix(), "its folder")
    except GateError as error:
        raise RegistryError(
            f"{error}: a file names Python of its own folder only; if you trust it, name it yourself, "
            f"stickslip --use {found} ..., or ss.registry.use_file({str(found)!r}) in Python"
        ) from error
    return found


def use_file(path: str | os.PathLike[str]) -> ModuleType:
    """Run a user's own Python file once, and return its module. Objects that it registers are then known.

    The file is run again only if its content has changed. A file that Python has already imported is not run.
    The file can import only modules that Python finds: the file's own folder is not added to the search path.

    Args:
        path: the Python file.

    Raises:
        RegistryError: no such file or not Python, it fails (the message names the line), or `nothing_run`.
    """
    file = Path(path).resolve()
    with _USING:
        try:
            content = hashlib.sha256(file.read_bytes()).hexdigest()
        except OSError as error:
            raise RegistryError(f"{path} cannot be read: {error.strerror}") from error
        before = _USED.get(str(file))
        if before is not None and before[0] == content:
            return before[1]
        made = _imported(str(file))
        if before is None and made is None and not _RUNS.get():
            raise RegistryError(_not_run_here(str(path)))
        if before is not None or made is None:
            made = _run(file, path, content)
        _USED[str(file)] = content, made
        return made


def used_files() -> tuple[str, ...]:
    """Return the paths of the users' files run so far, which other processes need to run too."""
    return tuple(_USED)


def check_used(text: str, folder: str | os.PathLike[str] = "") -> None:
    """Raise RegistryError if a name is ``path.py:Name`` and its file has not been run by `use_file`.

    Args:
        text: the name.
        folder: folder to which the path is relative.
    """
    path, _ = own_path(text)
    if path and str(Path(folder, path).resolve()) not in _USED:
        raise RegistryError(_not_run_here(text, path))


def _not_run_here(text: str, path: str = "") -> str:
    return f"{text} is of a file that is not run from here: stickslip --use {path or text} ... does"


def _run(file: Path, path: str | os.PathLike[str], content: str) -> ModuleType:
    # The name of the module, to which pickled records refer, is the same in every process.
    name = f"own_{file.stem}_{content[:8]}"
    if name in sys.modules:  # a file in another folder with the same name and content was run before
        name += f"_{hashlib.sha256(str(file).encode()).hexdigest()[:8]}"
    spec = spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise RegistryError(f"{path} is no file of Python: it must end in .py")
    made, before = module_from_spec(spec), sys.modules.get(name)
    sys.modules[name] = made
    try:
        spec.loader.exec_module(made)
    except (Exception, SystemExit) as error:
        if before is None:
            del sys.modules[name]
        else:
            sys.modules[name] = before
        raise RegistryError(f"{path} cannot be used: {_told(error, str(file))}") from error
    return made


def _imported(file: str) -> ModuleType | None:
    """Return the module that Python has already imported from a file (resolved path), or None."""
    return next((module for module in list(sys.modules.values()) if _is_of(module, file)), None)


def _is_of(module: Any, file: str) -> bool:
    found = getattr(module, "__file__", None)
    return (
        isinstance(found, str) and getattr(module, "__name__", "") != "__main__" and _resolved(found) == file
    )


@cache
def _resolved(file: str) -> str:
    return str(Path(file).resolve())


def _told(error: BaseException, file: str = "") -> str:
    trace, line = error.__traceback__, 0
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file:
            line = trace.tb_lineno
        trace = trace.tb_next
    return f"{type(error).__name__}: {error}" + (f" (line {line})" if line else "")


@cache
def _import_room(room: str) -> None:
    folder, packages, module = room.partition(".*")
    for found in iter_modules(getattr(import_module(folder), "__path__", ())):
        name = f"{folder}.{found.name}{module}"
        if found.ispkg == bool(packages) and (not module or find_spec(name) is not None):
            import_module(name)


@cache
def _entry_points(path: tuple[str, ...]) -> Any:
    del path  # `path` is sys.path, only a key of the cache: a new folder in it may contain entry points
    return entry_points()


laws = Kind("law", "laws", "friction")
waveforms = Kind("waveform", "waveforms", "waveform")
sensors = Kind("sensor", "sensors", "physics.electronics")
readers = Kind("reader", "readers", "recording.readers")
rigs = Kind("rig", "rigs", "rig.virtual", "rig.devices.*")
positioners = Kind("positioner", "positioners", "rig.devices.*")
twins = Kind("twin", "twins", "rig.devices.*.twin")
piezos = Kind("piezo model", "piezos", "physics.piezo")
controllers = Kind("controller", "controllers", "control")
steps = Kind("step", "steps", "jobs.steps")
