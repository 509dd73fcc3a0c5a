"""Plants of one layout and their states side by side, as the vector registers of a processor take them.

A room is one array of LANES columns, the entries of a row next to each other: the states, what a step makes
of each (the new state and the three vectors of its continuous extension), and the numbers of the plants, in
the order of `system.values_of`. A loop over the columns whose body is straight-line code becomes vector
instructions, with the same results to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable

from .system import Layout
from .writing import Text, tuple_of

LANES = 4
# Vectors of states in a column: the state, the new one, three of the continuous extension.
STATE, NEW, *EXTENSION = range(5)


def vector(layout: Layout, k: int) -> str:
    """The k-th vector of states in column p."""
    states = layout.first[-1]
    return tuple_of(f"room[{(k * states + c) * LANES} + p]" for c in range(states))


def first_number(layout: Layout) -> int:
    """The row in which the numbers of the plants begin."""
    return (1 + EXTENSION[-1]) * layout.first[-1]


def room_size(layout: Layout) -> Text:
    return Text([], f"({first_number(layout)} + numbers) * {LANES}")


def lane_state(layout: Layout) -> Text:
    return Text([], vector(layout, STATE))


def lane_step(layout: Layout) -> Text:
    return Text([], tuple_of([vector(layout, NEW), tuple_of(vector(layout, k) for k in EXTENSION)]))


def put_state(layout: Layout) -> Text:
    return Text([f"{vector(layout, STATE)} = q"], "None")


def put_step(layout: Layout) -> Text:
    extension = tuple_of(vector(layout, k) for k in EXTENSION)
    return Text([f"{vector(layout, NEW)} = new", f"{extension} = rows"], "None")


SOURCES: dict[str, Callable[[Layout], Text]] = {
    made.__name__: made for made in (room_size, lane_state, lane_step, put_state, put_step)
}
