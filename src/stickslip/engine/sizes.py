"""Macros with which the engine's C sources are compiled for plants of one layout (see `c/elements.inl`)."""

from __future__ import annotations

from typing import Any

from ..friction.law import element, elements, is_smooth
from .laws import functions


def largest(plant: Any) -> dict[str, int]:
    """Return the C macros LARGEST_MODES, LARGEST_ELEMENTS and LARGEST_STATES for plants of one layout, value
    by name; `c/plant.h` takes them as sizes of its arrays. `plant` is any plant of this layout."""
    return {
        "LARGEST_MODES": max(len(plant.modes), 1),
        "LARGEST_ELEMENTS": max(len(plant.elements), 1),
        "LARGEST_STATES": _states(plant),
    }


def sizes(plant: Any, suffix: str) -> dict[str, str]:
    """Return macros, value by name, with the properties that all plants of one layout have in common, so that
    the C compiler can unroll loops and omit conditions.

    Args:
        plant: one plant with this layout.
        suffix: suffix of the names of functions compiled with these macros.
    """
    modes, states = len(plant.modes), {elements(one.law) for one in plant.elements}
    statics = sum("breakaway" in functions(type(element(one.law, 0))) for one in plant.elements)
    alike = states.pop() if len(states) == 1 else None
    return {
        "OF(name)": f"name##_{suffix}",
        "ROOM_MODES": "LARGEST_MODES",
        "ROOM_ELEMENTS": "LARGEST_ELEMENTS",
        "ROOM_STATES": "LARGEST_STATES",
        "MODES(P)": f"((void)(P), {modes})",
        "ELEMENTS(P)": f"((void)(P), {len(plant.elements)})",
        "STATES(P)": f"((void)(P), {_states(plant)})",
        "STATES_OF(P, e)": "((P)->element[e].states)"
        if alike is None
        else f"((void)(P), (void)(e), {alike})",
        "FIRST(P, e)": "((P)->element[e].first)" if alike is None else f"({2 * modes} + (e) * {alike})",
        "STATIC(test)": {len(plant.elements): "(1 || (test))", 0: "(0 && (test))"}.get(statics, "(test)"),
        "WATCHED(test)": "(0 && (test))",
        "RARE(test)": "(test)" if any(map(_rare, plant.elements)) else "(0 && (test))",
    }


def _states(plant: Any) -> int:
    """Return the number of states of a plant: two per mode, and those of the elements."""
    return 2 * len(plant.modes) + sum(elements(one.law) for one in plant.elements)


def _rare(one: Any) -> bool:
    """Return True if an element of a plant needs code that a plain contact does not need.

    A plain contact has one bristle, or a static law, a constant normal force, and the sliding velocity as its
    only input."""
    kind = type(element(one.law, 0))
    roles = functions(kind)
    given = (one.position, one.feed, one.drive, one.drive_rate, one.loaded, one.along)
    usual = elements(one.law) == (0 if "breakaway" in roles else 1)
    odd = is_smooth(kind) or "choose" in roles or "tick" in roles
    return not usual or odd or any(part is not None for part in given)
