"""Plants of one layout and their states side by side, as the vector registers of a processor take them.

A room is one array of LANES columns, the entries of a row next to each other: the numbers of the plants (in
the order of `system.values_of`), their states, and what a step makes of each: the new state and the three
vectors of its continuous extension. A loop over the columns whose body is straight-line code becomes vector
instructions, with the same results to the last bit.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from .._jit import FUSED, overload_with
from .generated import record_maker, with_values
from .system import layout_of, numbers_of

LANES = 4
# Vectors of states in a room: the state, the new one, three of the continuous extension.
VECTORS = 5


@functools.cache
def _vector(numbers: int, states: int, k: int) -> str:
    """The text of the k-th vector of states in a column."""
    rows = (numbers + k * states + c for c in range(states))
    return "(" + " ".join(f"room[{row * LANES} + p]," for row in rows) + ")"


def _sizes(plant: Any) -> tuple[int, int]:
    return numbers_of(plant), layout_of(plant).first[-1]


@functools.cache
def _made(name: str, numbers: int, states: int) -> Callable[..., Any]:
    q, new, *dense = (_vector(numbers, states, k) for k in range(VECTORS))
    texts = {
        "room_size": f"lambda plant: {(numbers + VECTORS * states) * LANES}",
        "lane_state": f"lambda plant, room, p: {q}",
        "lane_step": f"lambda plant, room, p: ({new}, ({', '.join(dense)}))",
    }
    if name in texts:
        return eval(texts[name])
    given = {"put_state": "q", "put_step": "new, rows"}[name]
    put = [f"{q} = q"] if name == "put_state" else [f"{new} = new", f"{', '.join(dense)} = rows"]
    made: dict[str, Any] = {}
    exec("\n    ".join([f"def {name}(plant, room, p, {given}):", *put]), made)
    return made[name]


def room_size(plant: Any) -> int:
    """How many numbers a room for such plants has."""
    return _made("room_size", *_sizes(plant))(plant)


def lane_plant(plant: Any, room: Any, p: int) -> Any:
    """The plant of a column."""
    return with_values(plant, room[p::LANES])


def lane_state(plant: Any, room: Any, p: int) -> Any:
    """The state of a column."""
    return _made("lane_state", *_sizes(plant))(plant, room, p)


def lane_step(plant: Any, room: Any, p: int) -> Any:
    """The new state of a column, and the vectors of its continuous extension."""
    return _made("lane_step", *_sizes(plant))(plant, room, p)


def put_state(plant: Any, room: Any, p: int, q: Any) -> None:
    """Set the state of a column."""
    _made("put_state", *_sizes(plant))(plant, room, p, q)


def put_step(plant: Any, room: Any, p: int, new: Any, rows: Any) -> None:
    """Set the new state of a column, and the vectors of its continuous extension."""
    _made("put_step", *_sizes(plant))(plant, room, p, new, rows)


@overload_with(lane_plant, FUSED)
def _lane_plant(plant: Any, room: Any, p: Any) -> Any:
    return record_maker(plant, "plant, room, p", f"room[{{k}} * {LANES} + p]")


@overload_with(room_size, FUSED)
def _room_size(plant: Any) -> Any:
    return _made("room_size", *_sizes(plant))


@overload_with(lane_state, FUSED)
def _lane_state(plant: Any, room: Any, p: Any) -> Any:
    return _made("lane_state", *_sizes(plant))


@overload_with(lane_step, FUSED)
def _lane_step(plant: Any, room: Any, p: Any) -> Any:
    return _made("lane_step", *_sizes(plant))


@overload_with(put_state, FUSED)
def _put_state(plant: Any, room: Any, p: Any, q: Any) -> Any:
    return _made("put_state", *_sizes(plant))


@overload_with(put_step, FUSED)
def _put_step(plant: Any, room: Any, p: Any, new: Any, rows: Any) -> Any:
    return _made("put_step", *_sizes(plant))
