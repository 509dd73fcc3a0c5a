"""Run a user's law by its plain Python functions, which the engine calls back.

An exception of such a function cannot pass through C: it is kept, the engine is stopped, and `running` raises
it after the engine's return.
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

_MOST_RECORDS = 256  # largest number of records in the cache of a law
_THREAD = threading.local()


@contextmanager
def running() -> Iterator[Any]:
    """Yield a flag that stops the engine when a user's law raises; after the run, raise that exception."""
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
    """Return the C struct of a law whose functions call Python, and objects that must exist as long.

    Args:
        record: the user's record.
        kind: its type, as the translator sees it.
        interface: struct of friction laws, or of piezo models.
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
    """Function from a C pointer to a row of parameters to the record with these numbers; it caches records.

    Args:
        template: record with the fields that are not numbers.
        kind: type of the record.
        count: numbers in a row.
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
    """Return a copy of a record with its numbers replaced by `values`, without its checks."""
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
    """Return a C callback for a Python function with two results: it writes the force, and the rate of the
    state; NaN if the function raises. `said` names the function in messages."""

    def call(p: Any, *given: Any) -> None:
        *arguments, force, dz = given
        force[0] = dz[0] = math.nan
        if _stopped():
            return
        try:
            force[0], dz[0] = function(records(p), *arguments)
        except BaseException as error:  # also KeyboardInterrupt, which must stop the run
            force[0] = dz[0] = math.nan
            _failed(error, _called(said, arguments))

    return call


def _of_one(
    said: str, function: Callable[..., Any], records: _Records, kind: type[int] | type[float]
) -> Callable[..., Any]:
    """Return a C callback for a Python function with one result of the type `kind`; if it raises, NaN or 0.
    `said` names the function in messages."""
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
