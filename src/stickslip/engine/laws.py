"""Friction laws as C: the functions of `friction.law.register`, translated, behind the pointers of ``law.h``.

A law's parameters reach C as a row of numbers, the fields of its record one after the other: truths as 0 or
1, tuples and records inside it by their own numbers. What is no number (a text, None) is a constant of the C.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from ..friction import law as registered
from ..friction import normal_force
from .translator import BOOL, INT, REAL, Array, Record, Translation, TranslationError, record_type

# The roles of a law in `struct law`, with their declarations there.
ROLES = ("rate", "breakaway", "project", "tick", "choose", "branch_rate", "left")
_ARGUMENTS = {
    "rate": "real_t v, real_t z, real_t *force, real_t *dz",
    "breakaway": "",
    "project": "real_t z",
    "tick": "real_t v, real_t z",
    "choose": "real_t speed, real_t growth, real_t z",
    "branch_rate": "real_t speed, real_t z, int branch, real_t *force, real_t *dz",
    "left": "real_t speed, real_t growth, real_t z, int branch",
}
HEAD = """/* {what}
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_{guard}_H
#define STICKSLIP_{guard}_H

#include <stddef.h>

#include "law.h"

"""


class Signature(NamedTuple):
    """A role as C has it: kinds and names of its values, names of what it writes, and what it returns."""

    values: tuple[tuple[str, str], ...]
    results: tuple[str, ...]
    returns: str


def signature(role: str) -> Signature:
    """Return what a role takes after the row of parameters, and what it gives."""
    words = [tuple(word.rsplit(" ", 1)) for word in _ARGUMENTS[role].split(", ") if word]
    values = tuple((kind, name) for kind, name in words if not name.startswith("*"))
    results = tuple(name[1:] for _, name in words if name.startswith("*"))
    return Signature(values, results, "void" if results else "int" if role == "choose" else "real_t")


def functions(law_type: type) -> dict[str, Any]:
    """The Python function of each role that a law has."""
    made = registered._IMPLEMENTATIONS[law_type]
    found = {role: getattr(made, role) for role in ("rate", "breakaway", "project", "tick")}
    if made.branches:
        of = made.branches
        found |= {"choose": of.choose, "branch_rate": of.rate, "left": of.left}
    return {role: function for role, function in found.items() if function is not None}


def law_c(made: Translation, kind: Record) -> str:
    """The C of one law of this kind of record, with its ``struct law``.

    Raises:
        TranslationError: a function of the law is outside the subset that can be translated.
    """
    law_type = kind.record_class
    name, struct = law_type.__name__, made.record(kind)
    if not name.isascii():
        raise TranslationError(f"{name} cannot be translated to C: C takes names in ASCII only")
    fill = _filled(kind, iter(range(numbers(kind))))
    given, parts = functions(law_type), []
    for role, function in given.items():
        values, results, returns = signature(role)
        kinds = (kind, *(INT if one == "int" else REAL for one, _ in values))
        called, result = made.function(function, kinds, results)
        call = f"{called}({', '.join(['&law', *(word for _, word in values)])})"
        if results:
            if len(getattr(result, "members", ())) != len(results):
                raise TranslationError(f"{name} cannot be translated to C: {role} must give (force, dz)")
            body = [f"const {result.c_name} found = {call};"]
            body += [f"*{word} = found.{word};" for word in results]
        else:
            body = [f"return {call};" if result == returns else f"return ({returns}){call};"]
        head = ", ".join(["const real_t *p", *([_ARGUMENTS[role]] if values else [])])
        lines = [f"const {struct} law = {fill};", *(["(void)p;"] if not numbers(kind) else []), *body]
        text = "\n    ".join(lines)
        parts.append(f"static {returns} law_{role}_{name}({head})\n{{\n    {text}\n}}\n")
    period = place_of_period(kind) if "tick" in given else -1
    members = [f'"{name}"', f"{numbers(kind)}", f"{smooth(law_type)}", f"{period}"]
    members += [f"law_{role}_{name}" if role in given else "NULL" for role in ROLES]
    pairs = zip(("name", "parameters", "smooth", "period", *ROLES), members, strict=True)
    lines = "\n".join(f"    .{member} = {text}," for member, text in pairs)
    parts.append(f"static const struct law law_{name} = {{\n{lines}\n}};\n")
    return "\n".join(parts)


def numbers(kind: Any) -> int:
    """Return how many numbers a type has in a row of parameters."""
    if isinstance(kind, Record):
        return sum(numbers(inner) for _, inner in kind.fields)
    return kind.length if isinstance(kind, Array) else 1


def place_of_period(kind: Record) -> int:
    """Return which number of a row of parameters is the period of a sampled element."""
    names = [name for name, _ in kind.fields]
    return sum(numbers(inner) for _, inner in kind.fields[: names.index("period")])


def smooth(law_type: type) -> int:
    """Return 1 for an element without a kink at v = 0, 0 for a contact."""
    return int(registered.is_smooth(law_type))


def _filled(kind: Any, places: Iterator[int]) -> str:
    """The C of a record's fields, from the row p."""
    if isinstance(kind, Record):
        return f"{{{', '.join(_filled(inner, places) for _, inner in kind.fields) or '0'}}}"
    if isinstance(kind, Array):
        return f"{{{', '.join(f'p[{next(places)}]' for _ in range(kind.length))}}}"
    text = f"p[{next(places)}]"
    return {BOOL: f"{text} != R(0.0)", INT: f"r_whole({text})"}.get(kind, text)


def row(record: Any) -> list[float]:
    """A record's parameters as C takes them."""
    found: list[float] = []
    for name, inner in record_type(record).fields:
        value = getattr(record, name)
        if isinstance(inner, Record):
            found += row(value)
        else:
            found += map(float, value) if isinstance(inner, Array) else [float(value)]
    return found


def parameters(law: Any) -> list[float]:
    """The parameters of all elements of a law as C takes them, one after the other."""
    return [
        number for i in range(max(registered.elements(law), 1)) for number in row(registered.element(law, i))
    ]


def of_numbers(record_class: type) -> Record:
    """The type of a record all of whose fields are numbers."""
    return Record(record_class, tuple((name, REAL) for name in record_class._fields))  # type: ignore[attr-defined]


def packaged() -> list[type]:
    """The laws of the package that have an equation of their own, elements of composed ones among them."""
    own = __name__.split(".")[0]
    found = registered._IMPLEMENTATIONS.items()
    return [law for law, made in found if made.rate is not None and law.__module__.split(".")[0] == own]


def generated() -> dict[str, str]:
    """Name and text of the C files that are made from the laws of the package."""
    made = Translation()
    laws = [law_c(made, of_numbers(law)) for law in packaged()]
    names = "\n".join(f"    &law_{law.__name__}," for law in packaged())
    table = f"static const struct law *const packaged_laws[] = {{\n{names}\n}};\n"
    text = HEAD.format(what="The friction laws of the package in C.", guard="LAWS")
    text += "\n".join([made.text(), *laws, table, "#endif\n"])
    along, force = Translation(), of_numbers(normal_force.NormalForce)
    along.function(normal_force._along, (force, REAL), ("share", "steep", "curved"))
    for function in (normal_force._softening, normal_force._kept, normal_force._leaning):
        along.function(function, (force, REAL))
    along.function(normal_force._uniform, (force,))
    head = HEAD.format(what="The normal force along the stroke in C.", guard="NORMAL_FORCE")
    return {"laws.h": text, "normal_force.h": head + along.text() + "\n#endif\n"}
