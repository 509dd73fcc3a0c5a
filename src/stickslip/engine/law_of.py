"""Choose how the engine runs a friction law, one of the package or a user's own; a user's piezo model follows
the same rules.

A user's law runs as compiled C where a C compiler is installed and its functions can be translated; else
compiled by Numba where that is installed; else as plain Python functions. All three read the same row of
numbers (see `interface`). Nothing compiled is kept on disk: a compiler needs a twentieth of a second.
"""

from __future__ import annotations

import math
import sys
import threading
from typing import Any, NamedTuple

from . import called_back, numba_laws
from .compiled_law import compiled
from .interface import Interface, of_package, row
from .laws import LAW
from .library import packaged
from .translator import Record, record_type

# Largest relative difference between the results of a compiled law and of its Python functions. It is orders
# of magnitude above the rounding errors of any function of `math`.
AGREES = 1e-9


class EngineLaw(NamedTuple):
    """A law as the engine runs it.

    Fields: `pointer` to the C struct of the law; `how`, way in which its functions run: "package" (part of
    the library), "compiler", "numba" or "python"; `keeps`, objects that must exist as long as the struct.
    """

    pointer: Any
    how: str
    keeps: Any = None


_KNOWN: dict[Any, EngineLaw] = {}
_MAKING = threading.RLock()


def law_of(record: Any, slowest: bool = False, interface: Interface = LAW) -> EngineLaw:
    """Return the engine's law for records of this type and with these texts; results are cached.

    A message on stderr says if a user's law runs as plain Python because it cannot be compiled.

    Args:
        record: a registered law with an equation of its own; for a composed law, one of its elements.
        slowest: True: run a user's law as plain Python, for instance to debug it.
        interface: declaration of the C struct: that of friction laws by default, or that of piezo models.

    Raises:
        KeyError: the type of the record is not registered.
    """
    law_type = type(record)
    if of_package(law_type) and not slowest:
        return EngineLaw(packaged(interface.name)[law_type.__name__], "package")
    kind = record_type(record)
    numbers = {name for name, _ in kind.fields}
    rest = tuple((name, repr(value)) for name, value in record._asdict().items() if name not in numbers)
    key = (kind, rest, tuple(interface.functions(law_type).items()), slowest)
    with _MAKING:
        if key not in _KNOWN:
            _KNOWN[key] = _made(record, kind, slowest, interface)
    return _KNOWN[key]


def _made(record: Any, kind: Record, slowest: bool, interface: Interface = LAW) -> EngineLaw:
    for how, make in () if slowest else (("compiler", compiled), ("numba", numba_laws.compiled)):
        made = make(record, kind, interface)
        if made is not None and agrees(made[0], record, interface):
            return EngineLaw(made[0], how, made)
    if not slowest:
        print(
            f"stickslip: the {interface.noun} {type(record).__name__} runs as plain Python, some fifty times "
            "slower than compiled; install a C compiler, or pip install stickslip[numba]",
            file=sys.stderr,
        )
    made = called_back.law(record, kind, interface)
    return EngineLaw(made[0], "python", made)


def agrees(pointer: Any, record: Any, interface: Interface = LAW) -> bool:
    """Return True if a compiled law gives the same values as its Python functions, within `AGREES`, at all
    inputs of the interface. Inputs for which Python raises an arithmetic error are skipped.

    Args:
        pointer: C struct of the compiled law.
        record: record of the law, whose parameters are used.
        interface: declaration of the C struct.
    """
    from ._abi import ffi

    p, out = ffi.new("double[]", row(record) or [0.0]), ffi.new("double[2]")
    for role, function in interface.functions(type(record)).items():
        call = getattr(pointer, role)
        for arguments in interface.inputs(role):
            try:
                expected = function(record, *arguments)
            except (ArithmeticError, ValueError):  # here C gives infinity or NaN instead of an error
                continue
            if interface.signature(role).results:
                call(p, *arguments, out, out + 1)
                found = (out[0], out[1])
            else:
                expected, found = (expected,), (call(p, *arguments),)
            if not all(map(_same, found, map(float, expected))):
                return False
    return True


def _same(one: float, other: float) -> bool:
    if math.isfinite(one) and math.isfinite(other):
        return abs(one - other) <= AGREES * max(abs(one), abs(other), sys.float_info.min)
    return one == other or (math.isnan(one) and math.isnan(other))
