"""Pieces of the text that `dynamics` and `kinematics` write for one layout.

Names in the text: ``q2`` an entry of the state, ``a0`` the acceleration of mode 0, ``f0``, ``s0``, ``n0``
output, input and normal factor of element 0, ``z0_1`` what belongs to its state 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from .system import Layout, Shape


class Text(NamedTuple):
    """A function's body: its lines, and what it returns."""

    lines: list[str]
    result: str


def tuple_of(items: Iterable[str]) -> str:
    made = list(items)
    return f"({', '.join(made)}{',' if len(made) == 1 else ''})"


def sum_of(terms: Iterable[str]) -> str:
    return " + ".join(terms) or "0.0"


def padded(items: Iterable[str]) -> str:
    """A tuple with at least one entry: compiled code cannot index an empty one."""
    return tuple_of(list(items) or ["0.0"])


def present(there: tuple[bool, ...]) -> list[int]:
    return [i for i, yes in enumerate(there) if yes]


def along_terms(
    shape: Shape, e: int, velocity: Callable[[int], str], position: Callable[[int], str] | None
) -> list[str]:
    """Terms of an element's input that are linear in the state."""
    own = f"plant.elements[{e}]"
    terms = [f"{own}.velocity[{m}] * {velocity(m)}" for m in present(shape.velocity)]
    if position is not None:
        terms += [f"{own}.position[{m}] * {position(m)}" for m in present(shape.position)]
    return terms


def drive_terms(shape: Shape, e: int) -> list[str]:
    own = f"plant.elements[{e}]"
    terms = [f"{own}.drive * u[0]"] if shape.drive else []
    return terms + ([f"{own}.drive_rate * u[1]"] if shape.drive_rate else [])


def state_terms(shape: Shape, e: int) -> list[str]:
    """What the state ``q`` gives to an element's input."""
    return along_terms(shape, e, lambda m: f"q[{2 * m + 1}]", lambda m: f"q[{2 * m}]")


def fed_terms(shape: Shape, e: int, of: Callable[[int], str]) -> list[str]:
    return [f"plant.elements[{e}].feed[{i}] * {of(i)}" for i in present(shape.feed)]


def states_of(layout: Layout, e: int) -> list[tuple[str, str]]:
    """(record of the state's law, entry of the state) of each state of an element."""
    first, law = layout.first[e], f"plant.elements[{e}].law"
    return [(f"element({law}, {i})", f"q[{first + i}]") for i in range(layout.elements[e].states)]


def side_of(shape: Shape, e: int, i: int) -> str:
    """On which side of zero, and on which branch, the state i of an element is."""
    return f"branch_of(sides[{e}], {i})" if shape.branched else f"sides[{e}]"


def normal_of(e: int, shape: Shape) -> str:
    own = f"plant.elements[{e}].normal"
    return f"{own} * normal[0]" if shape.loaded else own


def own_push(shape: Shape, e: int) -> str:
    """What the output of an element does to the rate of its own input, through the bodies that it pushes."""
    own, shared = f"plant.elements[{e}]", [m for m in present(shape.velocity) if shape.push[m]]
    return sum_of(f"{own}.velocity[{m}] * {own}.push[{m}]" for m in shared)


def place_of(shape: Shape) -> int:
    """The mode along whose position the normal force changes: the last that it pushes."""
    return max(present(shape.push))


def share_along(e: int, shape: Shape) -> str:
    """p(x) with its steepness and curvature, see `friction.normal_force`."""
    return f"along(plant.elements[{e}].along, q[{2 * place_of(shape)}])"


def loaded_along(e: int, shape: Shape) -> list[str]:
    """Normal factor n, the factor on the rates of the states, and what a change of n does to them."""
    x, exponent = place_of(shape), f"plant.elements[{e}].along.stiffness_exponent"
    rate = "(normal[1] / normal[0] if normal[0] > 0.0 else 0.0) + " if shape.loaded else ""
    return [
        f"share{e}, steep{e}, curved{e} = {share_along(e, shape)}",
        f"n{e} = {normal_of(e, shape)} * share{e}",
        f"grows{e} = {rate}steep{e} * q[{2 * x + 1}]",
        f"part{e} = 1.0 if grows{e} > 0.0 else 1.0 - {exponent}",
        f"fresh = part{e} * grows{e}",
        f"soft{e} = softening(plant.elements[{e}].along, n{e})",
    ]


def loaded_share(e: int, shape: Shape) -> list[str]:
    """max(dN/dt, 0)/N and its derivative, for elements that feel the load."""
    if shape.along:
        return loaded_along(e, shape)
    if not shape.loaded or not shape.states:
        return []
    return [
        "fresh = normal[1] / normal[0] if normal[1] > 0.0 and normal[0] > 0.0 else 0.0",
        "dfresh = normal[2] / normal[0] - fresh * fresh if fresh > 0.0 else 0.0",
    ]


def leans(shape: Shape) -> bool:
    """Whether the force of an element may differ by its direction; a static law is refused an asymmetry."""
    return shape.along and not shape.static


def leaning_of(e: int) -> str:
    """The factor on the output of an element by its direction, see `friction.normal_force`."""
    return f"leaning(plant.elements[{e}].along, f{e})"


def static_elements(layout: Layout) -> list[int]:
    return [e for e, shape in enumerate(layout.elements) if shape.static]


def holding(layout: Layout, target: Callable[[int], str], acceleration: str, force: str) -> list[str]:
    """Lines that add the forces which keep the held contacts at rest; `target`: what their input's rate must
    cancel."""
    held = static_elements(layout)
    if not held:
        return []
    lines = []
    for i in held:
        shape = layout.elements[i]
        terms = along_terms(shape, i, lambda m: f"{acceleration}{m}", None)
        lines.append(f"b{i} = -({sum_of([*terms, target(i)])}) if sides[{i}] == 0.0 else 0.0")
        for j in held:
            shared = [m for m in present(shape.velocity) if layout.elements[j].push[m]]
            stiff = sum_of(
                f"plant.elements[{i}].velocity[{m}] * plant.elements[{j}].push[{m}]" for m in shared
            )
            one = "1.0" if i == j else "0.0"
            lines.append(f"A{i}_{j} = {stiff} if sides[{i}] == 0.0 and sides[{j}] == 0.0 else {one}")
    lines += eliminated(held, "A", "b")
    for i in held:
        lines.append(f"b{i} = b{i} if sides[{i}] == 0.0 else 0.0")
        lines.append(f"{force}{i} += b{i}")
        lines += [
            f"{acceleration}{m} += plant.elements[{i}].push[{m}] * b{i}"
            for m in present(layout.elements[i].push)
        ]
    return lines + [line for i in held for line in pin(layout, i, acceleration, f"-({target(i)})")]


def pin(layout: Layout, e: int, name: str, kept: str) -> list[str]:
    """A held contact moves the last of its bodies exactly as the others, to the last bit: true rest."""
    shape, own = layout.elements[e], f"plant.elements[{e}].velocity"
    moved = [m for m in present(shape.velocity) if shape.push[m]]
    if not moved:
        return []
    last = moved[-1]
    others = "".join(f" - {own}[{m}] * {name}{m}" for m in present(shape.velocity) if m != last)
    return [f"{name}{last} = ({kept}{others}) / {own}[{last}] if sides[{e}] == 0.0 else {name}{last}"]


def eliminated(rows: list[int], a: str, b: str) -> list[str]:
    """Gauss's elimination of the named entries; what is held twice over is held by the first."""
    lines = []
    for k, pivot in enumerate(rows):
        guard = f" if abs({a}{pivot}_{pivot}) > 1e-9 * S{pivot} else 0.0" if len(rows) > 1 else ""
        if guard:
            lines.insert(0, f"S{pivot} = abs({a}{pivot}_{pivot})")
        lines.append(f"p{pivot} = 1.0 / {a}{pivot}_{pivot}{guard}")
        for i in rows[k + 1 :]:
            lines.append(f"l = {a}{i}_{pivot} * p{pivot}")
            lines += [f"{a}{i}_{j} -= l * {a}{pivot}_{j}" for j in rows[k + 1 :]]
            lines.append(f"{b}{i} -= l * {b}{pivot}")
    for k in range(len(rows) - 1, -1, -1):
        i = rows[k]
        rest = "".join(f" - {a}{i}_{j} * {b}{j}" for j in rows[k + 1 :])
        lines.append(f"{b}{i} = ({b}{i}{rest}) * p{i}")
    return lines
