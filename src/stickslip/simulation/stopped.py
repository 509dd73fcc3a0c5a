"""A trajectory between end stops: free motion, impacts and rest at a stop, one piece after the other.

The engine has no end stops. Each piece is a run of the engine that ends where the position passes a stop. The
position is checked `PER_CYCLE` times a cycle; between two checks, its extremum is computed from positions and
velocities. The time of an impact is then found on the continuous extension of the integration steps.

At rest, a `Coulomb` contact with a large breakaway force R holds the body, and a constant force R pushes the
body off the stop. Together they resist only a push towards the stop: the body is released when the push
changes its direction, and then moves freely.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..engine.binding import ComposedPlant, DriveTable, integrate
from ..engine.outcome import DONE, TOO_MANY_STEPS
from ..friction import Coulomb, elements
from ..physics.actuator import Actuator, PulledSlider
from ..physics.end_stops import EndStops
from ..quantities.records import of_kind
from ..quantities.units import QuantityError, refuse_other_coordinate, unit_for, with_prefix
from .models import System
from .plant.system import Element, Plant

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

PER_CYCLE = 64.0  # number of checks of the position in the time 2 pi / rate of the plant
LOOKS = 4096  # largest number of checks in one run of the engine
CLOSE = 1e-3  # distance from a stop, over the tolerance, at which a body that rested there becomes free
STILL = 1e-3  # largest speed of a rebound that counts as rest at the stop, over tolerance times plant's rate
HALVINGS = 48  # halvings of the time between two checks, to find a body that leaves a stop and returns
# Holding force R per mass, over the plant's rate times the speed of the fastest impact: first value, factor
# by which it grows if it is too small, and largest factor.
FIRST_HOLD, STRONGER, MOST_HOLD = 30.0, 30.0, 1e12


class Impact(NamedTuple):
    """An impact on an end stop: its time, s, and the velocity of the body before it, m/s (rad/s)."""

    time: float
    velocity: float


class Stopped(NamedTuple):
    """Result of a run between end stops: outcome (see `engine.outcome`), time reached [s], number of accepted
    and of rejected integration steps, and impacts in chronological order."""

    outcome: int
    reached: float
    accepted: int
    rejected: int
    impacts: tuple[Impact, ...]


def refuse_end_stops(
    model: Actuator | PulledSlider, stops: EndStops | None, energy: bool, position: float
) -> None:
    """Raise QuantityError for end stops with which the model cannot be simulated.

    Reasons are stops in m for a rotary actuator or in rad for a linear model; an actuator with a clamped
    end-effector or a law without bristles; an energy account; or a start outside the stops.

    Args:
        model: the actuator or pulled slider.
        stops: the end stops; None is valid.
        energy: True if an energy account is requested.
        position: position of the end-effector at the start, m (rad).
    """
    if stops is None:
        return
    of_kind(stops, EndStops, "end_stops")
    refuse_other_coordinate(stops, model, "end_stops")
    unit = unit_for(model, "m")
    if isinstance(model, Actuator) and model.clamped:
        raise QuantityError("end_stops: the end-effector is clamped to the stage and meets no stop")
    if isinstance(model, Actuator) and elements(model.friction) == 0:
        raise QuantityError(
            f"end_stops: at a stop, {type(model.friction).__name__} would hold the end-effector to the stage "
            "and the stop at once; give the actuator a law with bristles, such as LuGre"
        )
    if energy:
        raise QuantityError("end_stops: the energy account lacks the loss of an impact; leave out energy")
    if not stops.low <= position <= stops.high:
        raise QuantityError(
            f"end_stops from {with_prefix(stops.low, unit)} to {with_prefix(stops.high, unit)} exclude the "
            f"start at {with_prefix(position, unit)}: give an initial_state, or other stops"
        )


def labelled_impacts(found: tuple[Impact, ...]) -> dict[str, xr.DataArray]:
    """Return the variable "impact_velocity" (m/s, before each impact) over the coordinate "impact_time" (s),
    in a dictionary by name."""
    import xarray as xr

    times, velocities = np.array(found).reshape(-1, 2).T
    when = xr.DataArray(times, dims="impact_time", attrs={"units": "s", "long_name": "time of an impact"})
    about = {"units": "m/s", "long_name": "velocity before an impact"}
    return {"impact_velocity": xr.DataArray(velocities, {"impact_time": when}, ("impact_time",), attrs=about)}


class StoppedRun:
    """A run of a trajectory between end stops, started by `follow`.

    Args:
        of: system of the model.
        stops: the end stops.
        drive, load, tolerance, careful, max_steps: as for `engine.binding.integrate`.

    Attributes:
        free: the plant without a stop, as the engine takes it.
        steps: numbers of accepted and of rejected steps until now.
        impacts: impacts until now.
    """

    def __init__(
        self,
        of: System,
        stops: EndStops,
        drive: DriveTable,
        load: DriveTable,
        tolerance: float,
        careful: bool,
        max_steps: int,
    ) -> None:
        self.of, self.stops, self.tables = of, stops, (drive, load)
        self.tolerance, self.careful, self.max_steps = tolerance, careful, max_steps
        self.free = ComposedPlant(of.plant)
        self.steps = [0, 0]
        self.impacts: list[Impact] = []

    def follow(self, q: Array, span: tuple[float, float], times: Array, samples: Array) -> Stopped:
        """Integrate from a state between the stops, through all impacts; return a `Stopped`.

        Args:
            q: state [states] at the start, replaced by the state at the time reached.
            span: start and end, s.
            times: sample times, s, ascending.
            samples: rows of the samples [times, columns], filled as by `engine.binding.integrate`.
        """
        t, end, x = span[0], span[1], self.of.slider
        filled = 0
        still = STILL * self.tolerance * self.of.plant.rate
        side, size = self._side(q, still), FIRST_HOLD
        outcome = DONE
        while t < end and outcome == DONE:
            plant, low, high = self.free, self.stops.low, self.stops.high
            if side:
                at = high if side > 0.0 else low
                q[x], q[x + 1] = at, 0.0
                push = size * self.of.plant.rate * max(still / STILL, self._fastest())
                plant = ComposedPlant(held(self.of.plant, x // 2, side, push))
                low, high = at - CLOSE * self.tolerance, at + CLOSE * self.tolerance
            begun, before = t, q.copy()
            outcome, t, passed, filled = self._piece(plant, q, t, end, low, high, times, samples, filled)
            if not passed:
                continue
            if side and passed == side:  # the stop's holding force was too small: repeat with a larger one
                if size > MOST_HOLD:
                    outcome = TOO_MANY_STEPS
                size, t, q[:] = STRONGER * size, begun, before
                filled = int(np.searchsorted(times, t))
                continue
            if side:
                side, size = 0.0, FIRST_HOLD
                continue
            velocity = float(q[x + 1])
            q[x] = self.stops.high if passed > 0.0 else self.stops.low
            q[x + 1] = -self.stops.restitution * velocity
            if abs(velocity) > still:
                self.impacts.append(Impact(t, velocity))
            side = passed if abs(q[x + 1]) <= still else 0.0
        return Stopped(outcome, t, self.steps[0], self.steps[1], tuple(self.impacts))

    def _side(self, q: Array, still: float) -> float:
        """Return the stop at which the body rests in the state q: -1 (lower), 1 (upper), or 0 if the body is
        at no stop, or leaves a stop faster than `still` [m/s]."""
        position, velocity = q[self.of.slider : self.of.slider + 2]
        for side, stop in ((-1.0, self.stops.low), (1.0, self.stops.high)):
            if position == stop and side * velocity >= -still:
                return side
        return 0.0

    def _fastest(self) -> float:
        return max((abs(one.velocity) for one in self.impacts), default=0.0)

    def _run(
        self, plant: ComposedPlant, q: Array, span: tuple[float, float], times: Array
    ) -> tuple[int, Array]:
        """Integrate a plant from a copy of the state q over `span` (start and end, s), and count the steps.

        Return the outcome (TOO_MANY_STEPS if all runs together exceed the limit), and the samples at `times`
        [s], [times, columns of the plant], NaN after the time reached."""
        rows = np.full((times.size, plant.columns), np.nan)
        outcome, _, accepted, rejected = integrate(
            *(plant, *self.tables, q.copy(), span, self.tolerance, self.careful, self.max_steps, times, rows)
        )
        self.steps[0] += accepted
        self.steps[1] += rejected
        return (TOO_MANY_STEPS if sum(self.steps) > self.max_steps else outcome), rows

    def _piece(
        self,
        plant: ComposedPlant,
        q: Array,
        t: float,
        end: float,
        low: float,
        high: float,
        times: Array,
        samples: Array,
        filled: int,
    ) -> tuple[int, float, float, int]:
        """Integrate a plant until its position leaves the range from `low` to `high` [m], at most through
        `LOOKS` checks.

        Args:
            plant, q: plant, and its state, which is replaced by the state at the time reached.
            t, end: start, and latest end, s.
            low, high: bounds of the position, m.
            times, samples: sample times [s] of the whole run, and rows of the samples, filled up to the time
                reached.
            filled: number of rows of `samples` that are filled already.

        Returns:
            The outcome (see `engine.outcome`), the time reached [s], the bound that is passed (-1 lower, 1
            upper, 0 none), and the new number of filled rows.
        """
        x, n = self.of.slider, self.free.states
        apart = 2.0 * np.pi / self.of.plant.rate / PER_CYCLE
        last = min(end, t + LOOKS * apart)
        own = times[filled : np.searchsorted(times, last, "right")]
        looks = np.append(np.arange(t + apart, last, apart), last)
        at = np.union1d(own, looks)
        at = at[at >= t]
        outcome, rows = self._run(plant, q, (t, last), at)
        known = np.isfinite(rows[:, x])
        count = at.size if known.all() else int(np.argmin(known))
        out = _outside(rows[:count, x], low, high)
        first = int(np.argmax(out != 0.0)) if out.any() else count
        peak = _peak(np.append(t, at[:first]), np.vstack([q[x : x + 2], rows[:first, x : x + 2]]), low, high)
        until = at[first] if first < count else np.nan
        if peak is not None:
            first, until = min(first, peak[0]), peak[1]
        kept = np.isin(at[:first], own, assume_unique=True)
        self._fill(samples, filled, rows[:first][kept])
        filled += int(kept.sum())
        if np.isnan(until):
            q[:] = rows[count - 1, :n] if count else q
            return outcome, float(at[count - 1]) if count else t, 0.0, filled
        if first:
            t, q[:] = float(at[first - 1]), rows[first - 1, :n]
        passed = self._passes(plant, q, t, float(until), low, high)
        if passed is None:  # only the interpolating cubic passed the bound, but not the motion itself
            _, found = self._run(plant, q, (t, float(until)), np.array([until]))
            q[:] = found[0, :n]
            return DONE, float(until), 0.0, filled
        return DONE, *passed, filled

    def _fill(self, samples: Array, filled: int, rows: Array) -> None:
        samples[filled : filled + len(rows)] = rows[:, : samples.shape[1]]

    def _passes(
        self, plant: ComposedPlant, q: Array, t: float, until: float, low: float, high: float
    ) -> tuple[float, float] | None:
        """Return the time [s] between `t` and `until` at which the position first passes a bound, and the
        bound (-1: `low`, 1: `high`, in m); None if it passes neither.

        The state q, given for the time `t`, is replaced by the state at the time returned; for None, q is
        unchanged. If the position is outside from the start, q only gets the velocity 0."""
        x, n = self.of.slider, self.free.states
        within = np.unique(t + (until - t) * 2.0 ** -np.arange(HALVINGS, -1.0, -1.0))
        rows = self._run(plant, q, (t, until), within[within > t])[1]
        at, out = within[within > t], _outside(rows[:, x], low, high)
        if not out.any():
            return None
        last = int(np.argmax(out != 0.0))
        if last == 0:  # the body is outside at the first instant: it rests at this stop
            q[x + 1] = 0.0
            return t, float(out[0])
        bound = high if out[last] > 0.0 else low

        def beyond(instant: float) -> float:
            return float(self._run(plant, q, (t, until), np.array([instant]))[1][0, x]) - bound

        instant = scipy.optimize.root_scalar(
            beyond, bracket=(at[last - 1], at[last]), xtol=1e-16, rtol=1e-15
        ).root
        q[:] = self._run(plant, q, (t, until), np.array([instant]))[1][0, :n]
        return instant, float(out[last])


def held(plant: Plant, mode: int, side: float, push: float) -> Plant:
    """Return the plant with a further element, the stop, which holds one mode (see the module).

    Args:
        plant: the free plant.
        mode: index of the body's mode.
        side: -1 for the lower stop, 1 for the upper one.
        push: R divided by the body's mass, m/s². The stop resists a push towards it up to twice as large.
    """
    shares = [0.0 if m != mode else 1.0 for m in range(len(plant.modes))]
    stop = Element(Coulomb(1.0), tuple(shares), tuple(-push * share for share in shares))
    body = plant.modes[mode]
    off = body._replace(acceleration=body.acceleration - side * push)
    modes = (*plant.modes[:mode], off, *plant.modes[mode + 1 :])
    return plant._replace(modes=modes, elements=(*plant.elements, stop))


def _outside(positions: Array, low: float, high: float) -> Array:
    """Return for each position [m] -1 below `low`, 1 above `high`, and 0 between the bounds [m]."""
    return np.where(positions > high, 1.0, np.where(positions < low, -1.0, 0.0))


def _peak(times: Array, states: Array, low: float, high: float) -> tuple[int, float] | None:
    """Return the first extremum of the position beyond a bound, between two checks: the index of the check
    before it, and its time [s]. Return None without such an extremum.

    The motion between two checks is approximated by the cubic through both positions and velocities.

    Args:
        times: times of the checks, s.
        states: position [m] and velocity [m/s] at the checks, [times, 2].
        low, high: bounds of the position, m.
    """
    h = np.diff(times)
    (x0, v0), (x1, v1) = states[:-1].T, states[1:].T
    turns = np.flatnonzero(v0 * v1 < 0.0)
    for k in turns.tolist():
        slope = (x1[k] - x0[k]) / h[k]
        a, b = 3.0 * (v0[k] + v1[k] - 2.0 * slope), 2.0 * (3.0 * slope - 2.0 * v0[k] - v1[k])
        roots = np.roots([a, b, v0[k]])
        inner = [r.real for r in roots if abs(r.imag) < 1e-12 and 0.0 < r.real < 1.0]
        for s in inner:
            place = x0[k] + h[k] * s * (v0[k] + s * (0.5 * b + s * a / 3.0))
            if not low <= place <= high:
                return k, float(times[k] + s * h[k])
    return None
