"""Friction laws as C: the functions of `friction.law.register`, translated, behind pointers (``law.h``)."""

from __future__ import annotations

from typing import Any

from ..friction import law as registered
from ..friction import normal_force
from .interface import Interface, numbers, of_numbers, of_package, row
from .translator import REAL, Record, Translation

HEAD = """/* {what}
 * Generated from the Python functions that are named below by `make laws`; do not edit. */
#ifndef STICKSLIP_{guard}_H
#define STICKSLIP_{guard}_H

#include <stddef.h>

#include "{include}"

"""
# Magnitudes of the velocities [m/s] and states [m] at which a compiled law is compared with its Python
# functions.
_SPEEDS = (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 1.0)
_STATES = (0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1.0)


def functions(law_type: type) -> dict[str, Any]:
    """Return the Python functions of a type of friction law, by their role ("rate", "breakaway", "project",
    "tick", "choose", "branch_rate", "left"); roles that it does not have are left out."""
    made = registered._IMPLEMENTATIONS[law_type]
    found = {role: getattr(made, role) for role in ("rate", "breakaway", "project", "tick")}
    if made.branches:
        of = made.branches
        found |= {"choose": of.choose, "branch_rate": of.rate, "left": of.left}
    return {role: function for role, function in found.items() if function is not None}


def _numbers(kind: Record) -> dict[str, int]:
    """Return the integer members of a law's struct, by name.

    "smooth" is 1 for an element without a kink at the velocity 0, else 0 (a contact). "period" is the index
    of a sampled element's period in its row of parameters; -1 for an element that is not sampled."""
    law = kind.record_class
    period = place_of_period(kind) if "tick" in functions(law) else -1
    return {"smooth": int(registered.is_smooth(law)), "period": period}


def place_of_period(kind: Record) -> int:
    """Return the index of the field `period` in the row of parameters of a sampled element, a type of the
    translator that has this field."""
    names = [name for name, _ in kind.fields]
    return sum(numbers(inner) for _, inner in kind.fields[: names.index("period")])


def _inputs(role: str) -> list[tuple[Any, ...]]:
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


# Declaration of the C struct `law` of friction laws.
LAW = Interface(
    name="law",
    noun="law",
    header="law.h",
    arguments={
        "rate": "real_t v, real_t z, real_t *force, real_t *dz",
        "breakaway": "",
        "project": "real_t z",
        "tick": "real_t v, real_t z",
        "choose": "real_t speed, real_t growth, real_t z",
        "branch_rate": "real_t speed, real_t z, int branch, real_t *force, real_t *dz",
        "left": "real_t speed, real_t growth, real_t z, int branch",
    },
    whole=frozenset({"choose"}),
    functions=functions,
    numbers=_numbers,
    inputs=_inputs,
)


def parameters(law: Any) -> list[float]:
    """Return the rows of parameters of all elements of a friction law, one after the other, as C reads
    them."""
    return [
        number for i in range(max(registered.elements(law), 1)) for number in row(registered.element(law, i))
    ]


def packaged() -> list[type]:
    """Return the types of the package's laws that have an equation of their own, including elements of
    composed laws."""
    found = registered._IMPLEMENTATIONS.items()
    return [law for law, made in found if made.rate is not None and of_package(law)]


def header(what: str, name: str, text: str, include: str = "law.h") -> str:
    """Return the text of a generated C header.

    Args:
        what: sentence about its contents, for the first line.
        name: name of the header without ".h", for its include guard.
        text: C source in it.
        include: name of the header that it includes.
    """
    return f"{HEAD.format(what=what, guard=name.upper(), include=include)}{text}\n#endif\n"


def generated() -> dict[str, str]:
    """Return the text of each C header that is generated from the package's laws, by file name."""
    along, force = Translation(), of_numbers(normal_force.NormalForce)
    along.function(normal_force.along, (force, REAL), ("share", "steep", "curved"))
    for function in (normal_force.softening, normal_force.kept, normal_force.leaning):
        along.function(function, (force, REAL))
    along.function(normal_force.uniform, (force,))
    return {
        "laws.h": header("The friction laws of the package in C.", "laws", LAW.packaged(packaged())),
        "normal_force.h": header("The normal force along the stroke in C.", "normal_force", along.text()),
    }
