"""A trajectory between end stops: free motion, impacts and rest at a stop, one piece after the other.

The engine knows no stops. Each piece is a run of its own, which ends where the position passes a stop. The
position is looked at `PER_CYCLE` times a cycle, and at its extremum between two looks, by the velocities. The
instant of an impact is then found on the continuous extension of the steps.

At rest, a `Coulomb` contact with a great breakaway force R holds the body, and a constant force of the size R
pushes the body off the stop. The two together resist a push towards the stop and no other: the body is
released where the push changes its direction, and its motion is then the free one.
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
from ..quantities.units import QuantityError, unit_for, with_prefix
from .models import System
from .plant.system import Element, Plant

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

PER_CYCLE = 64.0  # looks at the position in 2 pi / rate
LOOKS = 4096  # in one run of the engine
CLOSE = 1e-3  # of the tolerance: how far a body may leave a stop before its motion is that of the free plant
STILL = 1e-3  # of tolerance times rate: a rebound at a smaller speed is a rest
HALVINGS = 48  # of the time in which a body may have left a stop and come back
FIRST_HOLD, STRONGER, MOST_HOLD = 30.0, 30.0, 1e12  # R over the acceleration seen before, and its growth


class Impact(NamedTuple):
    """An impact: time, s; velocity before it, m/s."""

    time: float
    velocity: float


class Stopped(NamedTuple):
    """Result of a run, as `engine.binding.integrate` gives it, and its impacts."""

    outcome: int
    reached: float
    accepted: int
    rejected: int
    impacts: tuple[Impact, ...]


def refuse_end_stops(
    model: Actuator | PulledSlider, stops: EndStops | None, energy: bool, position: float
) -> None:
    """Raise QuantityError for stops that the model cannot have, or a start beyond them."""
    if stops is None:
        return
    of_kind(stops, EndStops, "end_stops")
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
    """Return the velocities before impacts over their times."""
    import xarray as xr

    times, velocities = np.array(found).reshape(-1, 2).T
    when = xr.DataArray(times, dims="impact_time", attrs={"units": "s", "long_name": "time of an impact"})
    about = {"units": "m/s", "long_name": "velocity before an impact"}
    return {"impact_velocity": xr.DataArray(velocities, {"impact_time": when}, ("impact_time",), attrs=about)}


class StoppedRun:
    """A run of a trajectory between end stops; arguments as those of `engine.binding.integrate`."""

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
        """Fill the samples [times, columns] from the state q, which becomes the last one."""
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
            if side and passed == side:  # the hold was too weak
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
        """Return the stop at which the body rests: -1 (lower), 1 (upper), or 0 where it moves faster than
        `still` [m/s]."""
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
        """Return the outcome and the samples [times, columns of the plant]; NaN where none was reached."""
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
        """Follow a plant until it passes a bound of its position, or through `LOOKS` looks.

        Returns the outcome, the time reached, the bound (-1, 1; 0 if none) and the number of filled samples;
        q becomes the state then.
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
        if passed is None:  # by the velocities it passes, by the positions it does not
            _, found = self._run(plant, q, (t, float(until)), np.array([until]))
            q[:] = found[0, :n]
            return DONE, float(until), 0.0, filled
        return DONE, *passed, filled

    def _fill(self, samples: Array, filled: int, rows: Array) -> None:
        samples[filled : filled + len(rows)] = rows[:, : samples.shape[1]]

    def _passes(
        self, plant: ComposedPlant, q: Array, t: float, until: float, low: float, high: float
    ) -> tuple[float, float] | None:
        """Return when [s] and which bound (`low` or `high` [m]) is passed before `until`, or None; q becomes
        the state then."""
        x, n = self.of.slider, self.free.states
        within = np.unique(t + (until - t) * 2.0 ** -np.arange(HALVINGS, -1.0, -1.0))
        rows = self._run(plant, q, (t, until), within[within > t])[1]
        at, out = within[within > t], _outside(rows[:, x], low, high)
        if not out.any():
            return None
        last = int(np.argmax(out != 0.0))
        if last == 0:  # it has never been away: it rests there
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
    """Return the plant with a mode that rests at a stop on its `side`, up to a push [m/s^2] towards it."""
    shares = [0.0 if m != mode else 1.0 for m in range(len(plant.modes))]
    stop = Element(Coulomb(1.0), tuple(shares), tuple(-push * share for share in shares))
    body = plant.modes[mode]
    off = body._replace(acceleration=body.acceleration - side * push)
    modes = (*plant.modes[:mode], off, *plant.modes[mode + 1 :])
    return plant._replace(modes=modes, elements=(*plant.elements, stop))


def _outside(positions: Array, low: float, high: float) -> Array:
    """Return -1 for positions below the bounds [m], 1 above, 0 between."""
    return np.where(positions > high, 1.0, np.where(positions < low, -1.0, 0.0))


def _peak(times: Array, states: Array, low: float, high: float) -> tuple[int, float] | None:
    """Return the interval, and the instant in it, of the first extremum beyond a bound between two looks.

    The motion between two looks is the cubic of their positions and velocities.
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
