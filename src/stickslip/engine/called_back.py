"""Run a user's law, or piezo model, by its plain Python functions, which the engine in C calls.

An exception of such a function cannot pass through C. So the exception is stored, the engine is stopped, and
`running` raises the exception after the engine has returned.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ._abi import ffi
from .interface import Interface
from .law_struct import begun
from .translator import BOOL, INT, Array, Record

_MOST_RECORDS = 256  # largest number of records in the cache of a law; a full cache is emptied
_THREAD = threading.local()


@contextmanager
def running() -> Iterator[Any]:
    """Yield a pointer to a C integer, the flag by which the engine sees that a user's law has raised an
    exception. On leaving the context, raise that exception.

    The flag counts only for calls from the present thread."""
    before = getattr(_THREAD, "run", None)
    flag = ffi.new("int32_t *", 0)
    _THREAD.run = run = [flag, None]
    try:
        yield flag
    finally:
        _THREAD.run = before
    if run[1] is not None:
        raise run[1]


def _failed(error: BaseException, what: str) -> None:
    run = getattr(_THREAD, "run", None)
    if run is None:
        raise error
    if run[1] is None:
        error.add_note(f"raised by {what}")
        run[0][0], run[1] = 1, error


def _stopped() -> bool:
    run = getattr(_THREAD, "run", None)
    return run is not None and run[1] is not None


def law(record: Any, kind: Record, interface: Interface) -> tuple[Any, Any]:
    """Return the C struct of a law whose functions call Python, and a tuple of objects that must exist as
    long as the struct.

    Args:
        record: the user's record: a friction law, or a piezo model.
        kind: the translator's type of the record.
        interface: declaration of the C struct, for friction laws or for piezo models.
    """
    made, name = begun(interface, kind)
    records = _Records(record, kind, made.parameters)
    callbacks = {}
    for role, function in interface.functions(type(record)).items():
        said = f"{role} of the {interface.noun} {type(record).__name__}"
        if interface.signature(role).results:
            wrapped = _of_two(said, function, records)
        else:
            wrapped = _of_one(said, function, records, int if role in interface.whole else float)
        callbacks[role] = ffi.callback(f"{interface.name}_{role}_fn", wrapped)
        setattr(made, role, callbacks[role])
    return made, (made, name, callbacks)


class _Records:
    """Callable that gets a C pointer to a row of parameters, and returns the record with these numbers.
    Records are cached.

    Args:
        template: record of this type, which provides the fields that are not numbers.
        kind: the translator's type of the record.
        count: number of parameters in a row.
    """

    def __init__(self, template: Any, kind: Record, count: int) -> None:
        self._template, self._kind, self._bytes = template, kind, 8 * count
        self._known: dict[bytes, Any] = {}

    def __call__(self, p: Any) -> Any:
        raw = ffi.buffer(p, self._bytes)[:] if self._bytes else b""
        found = self._known.get(raw)
        if found is None:
            if len(self._known) >= _MOST_RECORDS:
                self._known.clear()
            numbers: Any = ffi.unpack(p, self._bytes // 8) if self._bytes else ()
            found = self._known[raw] = _filled(self._template, self._kind, iter(numbers))
        return found


def _filled(template: Any, kind: Record, values: Iterator[float]) -> Any:
    """Return a copy of the record `template` with its numbers replaced by the next `values`, without checks;
    `kind` is the translator's type of the record."""
    fields = template._asdict()
    for name, inner in kind.fields:
        if isinstance(inner, Record):
            fields[name] = _filled(fields[name], inner, values)
        elif isinstance(inner, Array):
            fields[name] = tuple(next(values) for _ in range(inner.length))
        else:
            fields[name] = {BOOL: bool, INT: int}.get(inner, float)(next(values))
    return tuple.__new__(kind.record_class, tuple(fields.values()))


def _of_two(said: str, function: Callable[..., Any], records: _Records) -> Callable[..., None]:
    """Return a function for a C callback that calls a Python function with two results (force and rate of the
    state, for a friction law), and writes them through its last two pointers.

    Both are NaN if the function raises an exception, or an earlier call has. `said` names the function in
    messages; `records` converts the row of parameters to a record."""

    def call(p: Any, *given: Any) -> None:
        *arguments, force, dz = given
        force[0] = dz[0] = math.nan
        if _stopped():
            return
        try:
            force[0], dz[0] = function(records(p), *arguments)
        except BaseException as error:  # KeyboardInterrupt, too, must stop the run
            force[0] = dz[0] = math.nan
            _failed(error, _called(said, arguments))

    return call


def _of_one(
    said: str, function: Callable[..., Any], records: _Records, kind: type[int] | type[float]
) -> Callable[..., Any]:
    """Return a function for a C callback that returns the result, of the type `kind`, of a Python function;
    NaN (0 for int) if the function raises an exception, or an earlier call has. Other arguments as for
    `_of_two`."""
    none: Any = 0 if kind is int else math.nan

    def call(p: Any, *arguments: Any) -> Any:
        if _stopped():
            return none
        try:
            return kind(function(records(p), *arguments))
        except BaseException as error:
            _failed(error, _called(said, arguments))
            return none

    return call


def _called(said: str, arguments: Any) -> str:
    return f"{said}, called with {', '.join(f'{one:g}' for one in arguments)}"
