"""The engine's law for a record: one of the package, or a user's own in the quickest way that there is.

A user's law runs as compiled C where a C compiler is installed and its functions can be translated; compiled
by Numba where that is installed; and else as plain Python functions. All three see the same row of numbers
(see `laws`). Nothing that is compiled is kept on disk: a compiler needs a twentieth of a second.
"""

from __future__ import annotations

import math
import sys
import threading
from typing import Any, NamedTuple

from . import called_back, numba_laws
from .compiled_law import compiled
from .laws import functions, row, signature
from .library import packaged_laws
from .translator import Record, record_type

# Inputs at which a compiled law is compared with its Python functions, and the largest relative difference:
# orders above the rounding of any function of `math`.
_SPEEDS = (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
_STATES = (0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1.0)
AGREES = 1e-9


class EngineLaw(NamedTuple):
    """A law of the engine: a ``struct law *``, how its functions run ("package", "compiler", "numba" or
    "python"), and what must live as long as it does."""

    pointer: Any
    how: str
    keeps: Any = None


_KNOWN: dict[Any, EngineLaw] = {}
_MAKING = threading.RLock()


def law_of(record: Any, slowest: bool = False) -> EngineLaw:
    """The engine's law for records of this kind.

    Args:
        record: one with an equation of its own: no composed law, but an element of one.
        slowest: run a user's law as plain Python, for instance to step through it.

    Raises:
        TypeError: the record is no law.
    """
    law_type = type(record)
    if law_type.__module__.startswith("stickslip.friction.") and not slowest:
        return EngineLaw(packaged_laws()[law_type.__name__], "package")
    kind = record_type(record)
    numbers = {name for name, _ in kind.fields}
    rest = tuple((name, repr(value)) for name, value in record._asdict().items() if name not in numbers)
    key = (kind, rest, tuple(functions(law_type).items()), slowest)
    with _MAKING:
        if key not in _KNOWN:
            _KNOWN[key] = _made(record, kind, slowest)
    return _KNOWN[key]


def _made(record: Any, kind: Record, slowest: bool) -> EngineLaw:
    for how, make in () if slowest else (("compiler", compiled), ("numba", numba_laws.compiled)):
        made = make(record, kind)
        if made is not None and agrees(made[0], record):
            return EngineLaw(made[0], how, made)
    if not slowest:
        print(
            f"stickslip: the law {type(record).__name__} runs as plain Python, some fifty times slower than "
            "compiled; install a C compiler, or pip install numba",
            file=sys.stderr,
        )
    made = called_back.law(record, kind)
    return EngineLaw(made[0], "python", made)


def agrees(pointer: Any, record: Any) -> bool:
    """Return whether a compiled law gives what its Python functions give, where these give numbers.

    What a translator or a compiler takes to mean something else is not used.
    """
    from ._abi import ffi

    p, out = ffi.new("double[]", row(record) or [0.0]), ffi.new("double[2]")
    for role, function in functions(type(record)).items():
        call = getattr(pointer, role)
        for arguments in _arguments(role):
            try:
                expected = function(record, *arguments)
            except (ArithmeticError, ValueError):  # Python raises where C gives an infinity or no number
                continue
            if signature(role).results:
                call(p, *arguments, out, out + 1)
                found = (out[0], out[1])
            else:
                expected, found = (expected,), (call(p, *arguments),)
            if not all(map(_same, found, map(float, expected))):
                return False
    return True


def _arguments(role: str) -> list[tuple[Any, ...]]:
    states = [sign * z for z in _STATES for sign in (1.0, -1.0)]
    signed = [sign * v for v in _SPEEDS for sign in (1.0, -1.0)]
    if role == "breakaway":
        return [()]
    if role == "project":
        return [(z,) for z in states]
    if role in ("rate", "tick"):
        return [(v, z) for v in signed for z in states]
    if role == "choose":
        return [(v, growth, z) for v in _SPEEDS for growth in (-1.0, 0.0, 1.0) for z in states]
    if role == "branch_rate":
        return [(v, z, branch) for v in _SPEEDS for z in states for branch in (0, 1)]
    return [(v, 0.0, z, branch) for v in _SPEEDS for z in states for branch in (0, 1)]


def _same(one: float, other: float) -> bool:
    if math.isfinite(one) and math.isfinite(other):
        return abs(one - other) <= AGREES * max(abs(one), abs(other), sys.float_info.min)
    return one == other or (math.isnan(one) and math.isnan(other))
