"""A user's law compiled by Numba, where that is installed: for what the translator does not know."""

from __future__ import annotations

import dis
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

from ._abi import ffi
from .laws import ROLES, functions, numbers, place_of_period, smooth
from .translator import BOOL, INT, Array, Record

_REAL, _RESULT = "float64", "CPointer(float64)"
# Arguments after the row of parameters, and the type of what each role returns.
_SIGNATURES = {
    "rate": (("v", "z"), "void"),
    "breakaway": ((), _REAL),
    "project": (("z",), _REAL),
    "tick": (("v", "z"), _REAL),
    "choose": (("speed", "growth", "z"), "int32"),
    "branch_rate": (("speed", "z", "branch"), "void"),
    "left": (("speed", "growth", "z", "branch"), _REAL),
}


def compiled(record: Any, kind: Record) -> tuple[Any, Any] | None:
    """A law's ``struct law``, and what it needs to live; None without Numba, or where Numba refuses."""
    if find_spec("numba") is None:
        return None
    from numba.core.errors import NumbaError

    law_type = type(record)
    given = functions(law_type)
    if any(_raises(function, set()) for function in given.values()):
        return None  # a C function of Numba's prints what is raised, and continues
    made: Any = ffi.new("struct law *")
    name = ffi.new("char[]", law_type.__name__.encode("ascii", "replace"))
    made.name, made.parameters, made.smooth = name, numbers(kind), smooth(law_type)
    made.period = place_of_period(kind) if "tick" in given else -1
    functions_made = []
    try:
        for role in ROLES:
            if role in given:
                functions_made.append(_compiled(role, given[role], record, kind))
                setattr(made, role, ffi.cast(f"law_{role}_fn *", functions_made[-1].address))
    except (NumbaError, TypeError, ValueError, AttributeError, NotImplementedError):
        return None
    return made, (name, functions_made)


def _raises(function: Any, seen: set[Any]) -> bool:
    """Return whether a function, or one that it calls by a name of its module, raises."""
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


def _compiled(role: str, function: Any, record: Any, kind: Record) -> Any:
    """One role as a C function, which makes the record from the row of parameters."""
    import numba

    arguments, result = _SIGNATURES[role]
    known: dict[str, Any] = {"of": numba.njit(getattr(function, "py_func", function), error_model="numpy")}
    law = _filled(record, kind, iter(range(numbers(kind))), known)
    names = ["p", *arguments, *(("force", "dz") if result == "void" else ())]
    call = f"of({', '.join([law, *arguments])})"
    body = f"force[0], dz[0] = {call}" if result == "void" else f"return {call}"
    exec(f"def made({', '.join(names)}):\n    {body}\n", known)
    kinds = [_RESULT, *("int32" if one == "branch" else _REAL for one in arguments)]
    kinds += [_RESULT, _RESULT] if result == "void" else []
    return numba.cfunc(f"{result}({', '.join(kinds)})", error_model="numpy")(known["made"])


def _filled(template: Any, kind: Record, places: Iterator[int], known: dict[str, Any]) -> str:
    """The Python of a record from the row p; what is no number is a constant."""
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
