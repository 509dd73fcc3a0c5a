"""The search for orbits of maps that are known: a function stands in for the integration of a period."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from engine.library import built
from stickslip.engine import binding, members, orbits
from stickslip.engine.outcome import DONE
from stickslip.simulation.plant.system import Mode, Plant, values_of
from stickslip.waveform.drive import constant
from stickslip.waveform.members import common

Array = NDArray[np.float64]
# A state after a period at a tolerance, whose last position is the step, and the outcome. Of member `period`.
Map = Callable[[Array, float, float], tuple[Array, int]]

C = """
#include "orbits.c"
typedef int map_fn(double *state, double tolerance, double period);
STICKSLIP_API void map_is(map_fn *map);
static map_fn *map_of;
void map_is(map_fn *map)
{
    map_of = map;
}
int stickslip_integrate_near(const struct stickslip_task *task, const struct stickslip_near *near,
                             struct stickslip_result *result)
{
    *result = (struct stickslip_result){task->end, 1, 0};
    for (int64_t p = 0; p < near->count; p++)
        (void)map_of(near->states + p * near->plants[p].states, task->tolerance, task->end);
    return map_of(task->state, task->tolerance, task->end);
}
"""
RATE, TOLERANCE, STEP = 2.0, 1e-9, 2  # rad/s, m, the position that moves on
PLANT = Plant((Mode(1.0, 1.0, 0.0, 0.0), Mode(0.0, 1.0, 0.0, 0.0)), (), RATE)
N = 4


class Search:
    """The search for the orbits of a map, one for each period, and the states it starts from."""

    def __init__(
        self, library: Any, map_: Map, smooth: bool = True, periods: tuple[float, ...] = (1.0,)
    ) -> None:
        self.started: list[Array] = []
        self.smooth, self.periods = smooth, np.array(periods)
        self.states = np.tile([0.3e-6, 1e-6, 0.0, -2e-6], (len(periods), 1))
        self.outcomes = np.zeros(len(periods), np.int64)

        def called(state: Any, tolerance: float, period: float) -> int:
            q = np.ctypeslib.as_array(state, (N,))
            self.started.append(q.copy())
            q[:], outcome = map_(q.copy(), tolerance, period)
            return outcome

        kind = ctypes.CFUNCTYPE(
            ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.c_double, ctypes.c_double
        )
        self._called = kind(called)
        library.map_is(self._called)

    def found(self, most: int = 3000) -> orbits.Orbits:
        count = len(self.periods)
        return orbits.find_orbits(
            members.ComposedMembers(PLANT, np.repeat(values_of(PLANT), count, axis=0)),
            members.MemberDrives(common(constant(1.0)), np.zeros(count, np.int64)),
            binding.DriveTable(constant(1.0)),
            *(self.outcomes, self.states, self.periods, TOLERANCE, most, STEP, self.smooth),
        )


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("maps"), of=C)


@pytest.fixture
def library(maps: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    opened: Any = binding.ffi.dlopen(str(maps))
    monkeypatch.setattr(orbits, "library", lambda: opened)
    return ctypes.CDLL(str(maps))


RANDOM = np.random.default_rng(12)
TURNS = np.linalg.qr(RANDOM.normal(size=(3, 3)))[0]
SLOPES = TURNS @ np.diag([0.6, -0.3, 0.1]) @ TURNS.T  # of the map, by what is not the step, in metres
LEADS = np.array([0.7, -0.4, 0.2])  # of the step
REST, MOVES = np.array([0, 1, 3]), 1.3e-6  # entries of the state that are not the step; step on the orbit, m
SCALE = np.array([1.0, RATE, RATE])  # from metres
ORBIT = np.array([2e-6, -1e-6, 3e-6])


def linear(off: float = 0.0, slopes: Array = SLOPES) -> Map:
    """A linear map whose orbit is `ORBIT` times the period, off by so many tolerances."""

    def after(q: Array, tolerance: float, of: float) -> tuple[Array, int]:
        x = q[REST] / SCALE - of * ORBIT
        made = np.empty(N)
        made[REST] = SCALE * (of * ORBIT + slopes @ x + off * tolerance)
        made[STEP] = q[STEP] + of * MOVES + LEADS @ x + off * tolerance
        return made, DONE

    return after


@pytest.mark.parametrize("smooth", [True, False])
def test_orbits_of_a_linear_map(library: Any, smooth: bool) -> None:
    """One correction leads there; each member has its own place in every array."""
    search = Search(library, linear(), smooth, (1.0, 2.5))
    found = search.found()
    assert search.outcomes.tolist() == [DONE, DONE]
    for m, period in enumerate(search.periods):
        np.testing.assert_allclose(search.states[m, REST], SCALE * period * ORBIT, rtol=0.0, atol=1e-12)
        assert found.steps[m] == pytest.approx(period * MOVES, abs=1e-12)
        inner = found.jacobian[m][np.ix_(REST, REST)] * SCALE / SCALE[:, None]
        np.testing.assert_allclose(inner, SLOPES, atol=1e-3)
    np.testing.assert_allclose(found.radius, 0.6, rtol=1e-3)
    assert np.all(found.errors < 1e-2 * TOLERANCE)
    # The first period is alone; all others have three neighbours, for the largest multiplier is above a half.
    calls = len(search.started)
    assert found.periods.sum() == (2 + (calls - 2) // 2 if smooth else calls)


@pytest.mark.parametrize("off", [0.3, -0.3, 3.0])
def test_the_error_of_an_integration_is_seen_where_it_becomes_finer(library: Any, off: float) -> None:
    search = Search(library, linear(off=off))
    found = search.found()
    assert search.outcomes.tolist() == [DONE]
    assert abs(found.steps[0] - MOVES) < found.errors[0] < TOLERANCE
    apart = np.abs(search.states[0, REST] / SCALE - ORBIT).max()
    assert 1e-13 < apart < found.errors[0]


def doubled(q: Array, tolerance: float, period: float) -> tuple[Array, int]:
    """Beside an orbit that is not stable the motion goes from one side of it to the other, 1e-6 m away."""
    x, made = q[0], np.zeros(N)
    made[0] = -1.5 * x + 0.5 * x**3 / 1e-6**2
    made[STEP] = q[STEP] + MOVES + 0.7 * x
    return made, DONE


@pytest.mark.parametrize(("most", "least"), [(100, 100), (3000, 500)])
def test_an_orbit_into_which_no_motion_settles(library: Any, most: int, least: int) -> None:
    """After 500 periods of waiting its step is answered, with what the motion does instead as its error."""
    search = Search(library, doubled)
    found = search.found(most)
    assert search.outcomes.tolist() == [DONE]
    assert found.steps[0] == pytest.approx(MOVES, abs=1e-12)
    assert found.radius[0] == pytest.approx(1.5, rel=1e-3)
    assert found.errors[0] == pytest.approx(0.7e-6, rel=1e-6)
    assert least <= found.periods[0] <= least + 40


@pytest.mark.parametrize("most", [30, 40])
def test_a_search_ends_after_its_last_period(library: Any, most: int) -> None:
    """Newton's method nears a triple orbit by a third each time."""

    def tripled(q: Array, tolerance: float, period: float) -> tuple[Array, int]:
        made = np.zeros(N)
        made[0] = q[0] - q[0] ** 3 / 1e-6**2
        made[STEP] = q[STEP] + MOVES
        return made, DONE

    search = Search(library, tripled)
    found = search.found(most)
    assert search.outcomes.tolist() == [binding.library().NOT_FOUND]
    assert most <= found.periods[0] <= most + 1


def test_an_orbit_beside_which_nothing_can_be_followed_is_not_found(library: Any) -> None:
    """The derivatives would be of nothing."""
    whole = linear(slopes=np.diag([0.6, -0.3, 0.1]))

    def broken(q: Array, tolerance: float, period: float) -> tuple[Array, int]:
        after, _ = whole(q, tolerance, period)
        return after, binding.library().STEP_TOO_SMALL if q[0] > ORBIT[0] + 1e-8 else DONE

    search = Search(library, broken, smooth=False)
    search.found(100)
    assert search.outcomes.tolist() == [binding.library().NOT_FOUND]


def test_an_orbit_that_is_found_twice_is_the_one(library: Any) -> None:
    """The motion nears the orbit ever more slowly, and the first correction leads two thirds of the way
    there: it might settle into another one before. After 20 periods the search comes to the same one."""

    def slowing(q: Array, tolerance: float, period: float) -> tuple[Array, int]:
        x, made = q[0] - ORBIT[0], np.zeros(N)
        made[0] = q[0] - 0.005 * x - 0.01 * x * abs(x) / 1e-6
        made[STEP] = q[STEP] + MOVES
        return made, DONE

    search = Search(library, slowing)
    search.states[0, 0] = ORBIT[0] + 1e-6
    found = search.found()
    assert search.outcomes.tolist() == [DONE]
    assert search.states[0, 0] == pytest.approx(ORBIT[0], abs=TOLERANCE)
    assert 20 < found.periods[0] < 60
