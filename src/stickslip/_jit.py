"""The only Numba decorators of the package, and what they promise.

* `compiled`, `inlined`: plain functions that kernels call; compiled into them, never on their own.
* `overload`: one name, several implementations, chosen by the type of a record. Kernels that call the name
  stay module-level functions, so that they are cached on disk (a law passed in as a function would miss the
  cache in every new process).
* `kernel`: an entry point from Python. Cached on disk under a hash of all files with compiled code, because
  Numba itself looks only at the file of the kernel and would serve old physics after an edit in another one.

``NUMBA_DISABLE_JIT=1`` runs everything as plain Python, for coverage and for stepping through.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import inspect
import math
import os
import pickle
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache
from numba.extending import intrinsic
from numba.extending import overload as _numba_overload

from .lock import locked

_UNUSED = 30 * 24 * 3600.0  # s, after which kernels of other sources are removed
# s that are waited for another process that compiles the same kernel, or saves one: it may be stopped.
_COMPILES, _SAVES = 60.0, 10.0
# Nothing is called as a C function from elsewhere; wrappers for that took a tenth of the time to compile.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_PACKAGE = Path(__file__).parent
# The rooms that hold compiled code (tests/test_house.py sees to it): kernels depend on no other file.
KERNEL_ROOMS = ("_jit.py", "mechanism.py", "friction")


def _source_hash(files: list[Path], names: str = "") -> str:
    digest = hashlib.sha256(names.encode())
    for file in files:
        digest.update(file.name.encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """Where compiled kernels are kept: STICKSLIP_CACHE_DIR, or the user's cache folder."""
    given = os.environ.get("STICKSLIP_CACHE_DIR")
    if given:
        return Path(given)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
    return Path(base) / "stickslip"


@functools.cache
def _package_cache() -> Path:
    rooms = (_PACKAGE / room for room in KERNEL_ROOMS)
    files = [file for room in rooms for file in ([room] if room.is_file() else sorted(room.rglob("*.py")))]
    name = f"kernels-{_source_hash(files)}"
    try:
        return _in_use(_cache_root() / name)
    except OSError:  # a read-only home: still right, only slower in the next process
        user = os.getuid() if hasattr(os, "getuid") else 0
        return _in_use(Path(tempfile.gettempdir()) / f"stickslip-{user}" / name)


def _in_use(folder: Path) -> Path:
    """The folder, there and marked as used now; when it is new, old ones are removed."""
    while True:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            try:
                os.utime(folder)
            except FileNotFoundError:  # pruned since, by another process
                continue
        else:
            _prune(folder.parent, time.time() - _UNUSED)
        return folder


def _prune(root: Path, oldest: float) -> None:
    """Remove the kernels that no process has asked for since `oldest` [s, Unix time].

    A folder gets another name first: of several processes one removes it, and one that still wants it makes
    a new one instead of losing files while it reads them.
    """
    for folder in [*root.glob("kernels-*"), *root.glob("removed-*")]:  # of the latter, what was interrupted
        doomed = folder
        try:
            if folder.stat().st_mtime >= oldest:
                continue
            if folder.name.startswith("kernels-"):
                doomed = folder.rename(folder.with_name(f"removed-{os.getpid()}-{folder.name}"))
                if doomed.stat().st_mtime >= oldest:  # asked for in between
                    doomed.rename(folder)
                    continue
        except OSError:  # another process was first
            continue
        shutil.rmtree(doomed, ignore_errors=True)


class _Announcer(event.Listener):
    """Says in one line, once per process, that a kernel is being compiled and why the user waits.

    Python's garbage collector waits meanwhile: it would take an eighth of the time, to find next to nothing.
    """

    said = False
    _depth, _collects = 0, False  # one thread at a time compiles

    def on_start(self, event: Any) -> None:
        self._depth += 1
        if self._depth == 1:
            self._collects = gc.isenabled()
            gc.disable()
        dispatcher = event.data.get("dispatcher")
        if self.said or getattr(dispatcher, "py_func", None) not in _KERNELS:
            return
        type(self).said = True
        print(
            "stickslip: compiling the solver for this model, once on this machine (some seconds) ...",
            file=sys.stderr,
        )

    def on_end(self, event: Any) -> None:
        """Nobody need wait any longer for what could not be compiled."""
        self._depth -= 1
        if self._depth == 0 and self._collects:
            gc.enable()
        cache = getattr(event.data.get("dispatcher"), "_cache", None)
        if sys.exc_info()[0] is not None and isinstance(cache, _Cache):
            cache.release()


class _Cache(FunctionCache):
    """Kernels on disk that several processes share: of those that want the same one at once, one compiles it.

    Numba's own loses a kernel, or gives it the code of another, where two are saved at once, for an index and
    the code are two files (numba issue 10128); and where a file was cut off it raises each time (10434).
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._compiling = ExitStack()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = self._read(sig, target_context)
        if found is None:
            name = f"{self._impl.filename_base} {sig}"
            self._lock(self._compiling, hashlib.sha256(name.encode()).hexdigest()[:16], _COMPILES)
            found = self._read(sig, target_context)
            if found is not None:
                self.release()
        return found

    def _read(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # what a damaged file makes of unpickling can be any: it is compiled anew
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with self._compiling, ExitStack() as saving, suppress(OSError):  # a full disk: right, but not kept
            self._lock(saving, "index", _SAVES)
            try:
                super().save_overload(sig, data)
            except (EOFError, pickle.PickleError, ValueError, LookupError, AttributeError):
                self.flush()  # a damaged index
                super().save_overload(sig, data)

    def release(self) -> None:
        """Let others have the kernel that was about to be compiled."""
        self._compiling.close()

    def _lock(self, held: ExitStack, name: str, most: float) -> None:
        with suppress(OSError):  # a folder that cannot be written: nothing will be kept
            Path(self.cache_path).mkdir(parents=True, exist_ok=True)
            held.enter_context(locked(Path(self.cache_path) / f"{name}.lock", most))


_KERNELS: set[Callable[..., Any]] = set()
event.register("numba:compile", _Announcer())


def compiled(function: Callable[..., Any]) -> Any:
    """A function to be called from kernels (from Python too, for tests)."""
    return numba.njit(function, **_OPTIONS)


def inlined(function: Callable[..., Any]) -> Any:
    """As `compiled`, but always inlined: for what the hot loops call. A call passes every field of every
    record and array by itself, which costs more than most of these functions; inlined, a step takes half the
    time."""
    return numba.njit(function, forceinline=True, **_OPTIONS)


def fused(function: Callable[..., Any]) -> Any:
    """As `inlined`, with a product and the sum after it rounded once, which is an eighth quicker. Not for
    code that asks whether two sums are exactly equal, as the rest of a static law does; and not to be called
    from Python: the wrapper for it would take time to compile."""
    bare: dict[str, Any] = {"no_cpython_wrapper": True}
    return numba.njit(function, forceinline=True, fastmath={"contract"}, **_OPTIONS, **bare)


# As of `fused`, for what `overload_with` chooses.
FUSED: dict[str, Any] = {**_OPTIONS, "forceinline": True, "fastmath": {"contract"}}


def overload_with(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """As `overload`, compiled with these options."""
    return _numba_overload(function, jit_options=options, strict=False, target="generic")  # type: ignore[arg-type]


def overload(function: Callable[..., Any]) -> Any:
    """What `function` becomes inside kernels: the decorated function gets types and returns an
    implementation."""
    return _numba_overload(function, jit_options=_OPTIONS, strict=False, target="generic")  # type: ignore[arg-type]


# 2^52 + 2^51: added to a number, it leaves its nearest integer in the last bits.
SHIFT = 6755399441055744.0


def two_to(shifted: float) -> float:
    """2^k of the number k + SHIFT."""
    return math.ldexp(1.0, int(shifted - SHIFT)) if shifted == shifted else shifted


@intrinsic
def _with_exponent(typing: Any, shifted: Any) -> Any:
    """The last bits become the exponent."""

    def bits(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        k = builder.shl(builder.bitcast(arguments[0], word), word(52))
        return builder.bitcast(builder.add(k, word(1023 << 52)), ir.DoubleType())

    return types.float64(types.float64), bits


@overload_with(two_to, FUSED)
def _two_to(shifted: Any) -> Any:
    return lambda shifted: _with_exponent(shifted)  # pyright: ignore[reportCallIssue]


def record_class(numba_type: Any) -> type | None:
    """The Python class of a record's Numba type (used inside `overload` functions)."""
    return getattr(numba_type, "instance_class", None)


def _foreign_source(law_type: type) -> Path | None:
    """The user's file that defines a law, or None for a law of this package."""
    if law_type.__module__.split(".")[0] == __package__:
        return None
    try:
        return Path(inspect.getfile(law_type)).resolve()
    except (OSError, TypeError):  # typed in at a prompt
        return Path()


_ATTACHING = threading.RLock()


class Kernel:
    """A compiled entry point whose first argument is a plant, or one record.

    Laws of the package share one cache on disk. A law in a user's own file gets a cache of its own, keyed by
    that file's content, so an edit there is never served stale; a law from a prompt or a script run as
    ``__main__`` cannot be named in another process and is compiled anew.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        functools.update_wrapper(self, function)
        _KERNELS.add(function)
        self._function = function
        self._dispatchers: dict[str, Callable[..., Any]] = {}
        self._by_type: dict[tuple[type, ...], Callable[..., Any]] = {}

    def __call__(self, record: Any, *args: Any) -> Any:
        laws = tuple(type(e.law) for e in record.elements) if hasattr(record, "elements") else (type(record),)
        dispatcher = self._by_type.get(laws)
        if dispatcher is None:
            with _ATTACHING:  # the place of a cache is a setting of the whole process
                dispatcher = self._by_type[laws] = self._dispatcher(laws)
        return dispatcher(record, *args)

    def _dispatcher(self, laws: tuple[type, ...]) -> Callable[..., Any]:
        if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
            return self._function
        sources = {law: _foreign_source(law) for law in laws}
        foreign = sorted({source for source in sources.values() if source is not None})
        if any(source == Path() or law.__module__ == "__main__" for law, source in sources.items() if source):
            return numba.njit(self._function, **_OPTIONS)
        folder = _package_cache()
        if foreign:  # what is kept names its modules, and is of no use to who calls them otherwise
            names = ",".join(sorted({law.__module__ for law, source in sources.items() if source}))
            folder /= f"law-{_source_hash(foreign, names)}"
        key = str(folder)
        if key not in self._dispatchers:
            before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
            numba.config.CACHE_DIR = key  # type: ignore[attr-defined]
            try:  # the setting is read when the cache is attached
                cache = _Cache(self._function)
            finally:
                numba.config.CACHE_DIR = before  # type: ignore[attr-defined]
            made: Any = numba.njit(self._function, **_OPTIONS)
            made._cache = cache  # as its option `cache` does with Numba's own
            self._dispatchers[key] = made
        return self._dispatchers[key]


def kernel(function: Callable[..., Any]) -> Kernel:
    """Decorator: see `Kernel`."""
    return Kernel(function)
