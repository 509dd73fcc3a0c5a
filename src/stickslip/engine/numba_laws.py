"""Compile a user's law by Numba, if that is installed, when the law cannot be compiled as C."""

from __future__ import annotations

import dis
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from ._abi import ffi
from .interface import CallSignature, Interface, numbers
from .law_struct import begun
from .translator import BOOL, INT, Array, Record

# Name in Numba of each C type.
_KINDS = {"real_t": "float64", "int": "int32", "void": "void"}
_POINTER = "CPointer(float64)"


def compiled(record: Any, kind: Record, interface: Interface) -> tuple[Any, Any] | None:
    """Return the C struct of a law compiled by Numba, and objects that must exist as long as the struct.
    Return None without Numba, if Numba fails, or if a function of the law contains a raise statement.

    The arguments are those of `called_back.law`."""
    if find_spec("numba") is None:
        return None
    from numba.core.errors import NumbaError

    given = interface.functions(type(record))
    if any(_raises(function, set()) for function in given.values()):
        return None  # C functions made by Numba only print an exception, and the run would continue
    made, name = begun(interface, kind)
    functions_made = []
    try:
        for role, function in given.items():
            functions_made.append(_compiled(interface.signature(role), function, record, kind))
            setattr(made, role, ffi.cast(f"{interface.name}_{role}_fn *", functions_made[-1].address))
    except (NumbaError, TypeError, ValueError, AttributeError, NotImplementedError):
        return None
    return made, (name, functions_made)


def _raises(function: Any, seen: set[Any]) -> bool:
    """Return True if a function, or one that it calls by a global name of its module, contains a raise
    statement. `seen`, the functions that are already checked, is extended."""
    plain = getattr(function, "py_func", function)
    code = getattr(plain, "__code__", None)
    if code is None or plain in seen:
        return False
    seen.add(plain)
    pending = [code]
    while pending:
        one = pending.pop()
        if any(step.opname == "RAISE_VARARGS" for step in dis.get_instructions(one)):
            return True
        pending += [inner for inner in one.co_consts if hasattr(inner, "co_consts")]
    called = (plain.__globals__.get(name) for name in code.co_names)
    functions = (one for one in called if hasattr(one, "__code__") or hasattr(one, "py_func"))
    return any(_raises(one, seen) for one in functions)


def _compiled(signature: CallSignature, function: Any, record: Any, kind: Record) -> Any:
    """Return a C function made by Numba, which builds the record from the row of parameters and calls the
    Python function of one role.

    Args:
        signature: C signature of the role.
        function: Python function of the role.
        record: record that provides texts and None.
        kind: the translator's type of the record.
    """
    import numba

    values, results, returns = signature
    arguments = [name for _, name in values]
    known: dict[str, Any] = {"of": numba.njit(getattr(function, "py_func", function), error_model="numpy")}
    law = _filled(record, kind, iter(range(numbers(kind))), known)
    call = f"of({', '.join([law, *arguments])})"
    body = f"{', '.join(f'{one}[0]' for one in results)} = {call}" if results else f"return {call}"
    exec(f"def made({', '.join(['p', *arguments, *results])}):\n    {body}\n", known)
    kinds = [_POINTER, *(_KINDS[kind] for kind, _ in values), *(_POINTER for _ in results)]
    return numba.cfunc(f"{_KINDS[returns]}({', '.join(kinds)})", error_model="numpy")(known["made"])


def _filled(template: Any, kind: Record, places: Iterator[int], known: dict[str, Any]) -> str:
    """Return the Python expression, as text, that builds a record from the row of parameters p.

    Args:
        template: record that provides texts and None.
        kind: the translator's type of the record.
        places: iterator over the indices of the row, of which the record takes the next ones.
        known: objects by name that the expression may use, to which classes, texts and None are added.
    """
    name = f"class_{len(known)}"
    known[name] = kind.record_class
    types, parts = dict(kind.fields), []
    for field, value in template._asdict().items():
        inner = types.get(field)
        if isinstance(inner, Record):
            parts.append(_filled(value, inner, places, known))
        elif isinstance(inner, Array):
            parts.append(f"({', '.join(f'p[{next(places)}]' for _ in range(inner.length))},)")
        elif inner is None:
            known[f"constant_{len(known)}"] = value
            parts.append(list(known)[-1])
        else:
            text = f"p[{next(places)}]"
            parts.append({BOOL: f"{text} != 0.0", INT: f"int({text})"}.get(inner, text))
    return f"{name}({', '.join(parts)})"
