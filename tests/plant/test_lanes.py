"""Plants side by side in a room: what is put into a column comes out of it, and no other changes."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip._jit import compiled
from stickslip.plant import generated
from stickslip.plant.lanes import LANES
from stickslip.plant.system import Plant, state_size, values_of

from .layouts import CASES


# What only kernels call has no way in from Python; these have.
@compiled
def size(plant, numbers):
    return generated.room_size(plant, numbers)


@compiled
def column(plant, room, p):
    return (
        generated.lane_plant(plant, room, p),
        generated.lane_state(plant, room, p),
        generated.lane_step(plant, room, p),
    )


@compiled
def put(plant, room, p, q, new, rows):
    generated.put_state(plant, room, p, q)
    generated.put_step(plant, room, p, new, rows)


@pytest.mark.parametrize("name", ["stage and slider", "three contacts"])
def test_what_is_put_into_a_column_comes_out_of_it(name: str) -> None:
    plant: Plant = CASES[name].plant
    numbers, states = values_of(plant).shape[1], state_size(plant)
    assert size(plant, numbers) == (numbers + 5 * states) * LANES
    room = np.arange(float(size(plant, numbers)))
    table, before = room.reshape(-1, LANES), room.reshape(-1, LANES).copy()
    vectors = [tuple((100.0 * k + np.arange(states)).tolist()) for k in range(5)]
    for p in range(LANES):
        table[5 * states :, p] = values_of(plant)[0] + p
        put(plant, room, p, vectors[0], vectors[1], tuple(vectors[2:]))
        own, q, (new, rows) = column(plant, room, p)
        np.testing.assert_array_equal(values_of(own), values_of(plant) + p)
        assert (q, new, rows) == (vectors[0], vectors[1], tuple(vectors[2:]))
        np.testing.assert_array_equal(table[:, p + 1 :], before[:, p + 1 :])
