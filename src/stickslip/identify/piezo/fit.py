"""`identify_piezo`: fit of a piezo's hysteresis, asymmetry, creep, delay and lag, with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...estimate.fit import fit_least_squares
from ...estimate.lack import KnownNoise
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import Problem, Residuals
from ...estimate.result import Fit
from ...physics.actuator import Actuator
from ...physics.piezo import Creep, Piezo, PrandtlIshlinskii
from ...physics.piezo.creep import distance
from ...quantities.units import QuantityError, optional_si, to_si
from ...recording import RecordingError
from ..recorded.channels import names_of, recordings_of, refuse_clipped, unit_of
from ..recorded.known_noise import first_change, more_than_white, resolution, white_noise
from ..recorded.levels import converter_step
from ..recorded.screen import PositionUnderDrive, refuse_against, refuse_noise, refuse_swapped, said_gain
from ..scales import DRIVE, by_prediction, with_scales
from .choice import ENOUGH, Choice, Shape, chosen, left_of_all, range_of
from .columns import (
    Columns,
    DelayAndLag,
    Observed,
    PlayGrid,
    at_piezo,
    columns,
    observe,
    refuse_one_way,
    repeated,
)
from .linear import Solution, solved
from .prediction import PiezoPrediction
from .shapes import first_model, lagging_shape, skewed_shape
from .timing import Edges, Lateness, edges_of, lateness

if TYPE_CHECKING:
    import xarray as xr

OBSERVED = "stage_position"
NOT_LATE = Lateness(
    DelayAndLag(),
    ("delay and lag are taken as 0 s: what the edges of the drive show of them predicts no better",),
    Edges((), ()),
)
# A recording is not explained if its rms residual exceeds MANY times its white noise and the share TOO_LITTLE
# of the standard deviation of its positions. A straight line leaves 10 to 15 %, fits of stacks 1 %.
MANY, TOO_LITTLE = 3.0, 0.05
LATE = 0.1  # smallest relative reduction of the held-out residual by a lag that no edge of the drive shows
MOVED = 0.01  # smallest change of the drive from its first value that is a motion, relative to its range
# DIFFERENCE: step of delay and lag for derivatives, in sampling intervals. KEPT: number of cached pairs.
DIFFERENCE, KEPT = 0.02, 4
SKEWED = 1e-4  # step of the skew for numerical derivatives, multiplied by the range of the drive

Array = NDArray[np.float64]


def identify_piezo(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Actuator | None = None,
    *,
    operators: int | None = None,
    asymmetric: bool | None = None,
    creep: bool | None = None,
    time_constants: Sequence[float | str] = (),
    delay: float | str | None = None,
    lag: float | str | None = None,
    rest_voltage: float | str | None = None,
    observed: str = OBSERVED,
) -> Fit:
    r"""Fit Prandtl-Ishlinskii hysteresis and creep to recordings of voltage and displacement.

    .. math:: y = y_0 + S + g\,L[S], \qquad
              S = \sum_i w_i P_{r_i}[u + a\,B(u) - a\,B(0)] + \kappa\,B(u)

    u is the voltage at the piezo, P are play operators, B is the square of the voltage above its least value,
    and L is logarithmic creep of one per decade. The displacement must be the piezo's alone: without contact,
    slower than the stage's resonance. Thresholds are spread evenly over half the range of the drive, because
    wider plays are not identifiable. Creep lasts from 0.1 s to the length of the recordings, or ten times as
    long if that fits better. Cross-validation chooses the number of plays, B and L: the smallest model that
    predicts held-out parts about as well as the best one. If its residuals exceed the noise, the skew a may
    be added, which widens loops at one end. Delay and lag come from edges of the drive if they reduce the
    residual. Without edges, a lag is added if it predicts held-out parts clearly better. Each recording
    starts after a rest or in motion, whichever fits better.

    Args:
        recordings: with drive_voltage [V] and stage_position [m].
        model: actuator whose gain and piezo are replaced in the result.
        operators: number of plays; by default chosen by cross-validation.
        asymmetric: include B(u), and possibly a; by default chosen by cross-validation.
        creep: include creep; by default chosen by cross-validation.
        time_constants: time constants of creep, s, with equal shares; by default two per decade from 0.1 s.
        delay: delay of the voltage at the piezo, s; by default from edges, or 0 if `lag` is given.
        lag: time constant of amplifier and sensor, s; by default from edges, or 0 if `delay` is given.
        rest_voltage: voltage before each recording, V, reached from 0 V; by default estimated.
        observed: name of the position channel.

    Returns:
        A fit of the plays' weight_1, ... [m/V] and their sum gain, curvature κ [m/V²], skew a [1/V], creep g
        (share per decade), delay and lag [s], and the offset of each recording [m]. `predict(recording)` is
        the position, m, at the level of the recording's own positions, if it has any. `model` is the
        actuator, or a `Piezo`. `failures` name recordings with large residuals.

    Raises:
        RecordingError: a channel is missing, short, not finite, clipped, constant, noise, or falls where the
            voltage rises; the drive never reverses; or the fitted hysteresis has no inverse.
        QuantityError: a number is out of range, or the recordings do not determine it.
        FitError: see `fit_least_squares`.
    """
    taus = sorted(to_si(tau, "s", "time_constants") for tau in time_constants)
    given = optional_si(delay, "s", "delay"), optional_si(lag, "s", "lag")
    rest = optional_si(rest_voltage, "V", "rest_voltage")
    found = recordings_of(recordings)
    unit = unit_of(found, observed) or "m"
    seen = [observe(r, name, observed, rest) for r, name in zip(found, names_of(found), strict=True)]
    for one in seen:
        refuse_noise(one.position, observed, one.name, one.drive)
        refuse_swapped(PositionUnderDrive(one.name, observed, unit, one.time, one.position, one.drive))
        refuse_clipped(one.position, observed, one.name, one.drive, converter_step(one.position))
    refuse_one_way(seen)
    late = _lateness(seen, *given)
    for one in seen:
        drive = at_piezo(one, late.timing)
        refuse_against(PositionUnderDrive(one.name, observed, unit, one.time, one.position, drive))
    for assumed in (0.0, None) if rest is None else ():
        begun = _begun(seen, late.timing, assumed)
        if all(one.begins_as(other) for one, other in zip(seen, begun, strict=True)):
            break
        seen = begun
        late = _lateness(seen, *given)
    bends = [bent for bent in (False, True) if asymmetric in (None, bent)]
    choice = chosen(seen, [Shape(bent, 0.0, late) for bent in bends], operators, creep, taus)
    if late.edges.number:
        other = chosen(seen, [Shape(bent, 0.0, NOT_LATE) for bent in bends], operators, creep, taus)
        if not _explains_more(seen, choice, other):
            choice, late = other, NOT_LATE
    fit, remarks = _fitted(seen, choice, unit)
    if asymmetric is not False and not _only_noise(fit, seen):
        skewed = skewed_shape(seen, late, fixed=given != (None, None))
        # Without skew but with the new delay too: a skew must not be chosen for an effect of another delay.
        shapes = [skewed, *([skewed._replace(skew=0.0)] if skewed.late != late else [])]
        other = chosen(seen, shapes, operators, creep, taus)
        if other.score < (1.0 - ENOUGH) * choice.score:
            choice = other
            fit, remarks = _fitted(seen, choice, unit)
    if not late.edges.number and given == (None, None) and not _only_noise(fit, seen):
        shape = lagging_shape(seen, choice)
        other = chosen(seen, [shape], operators, creep, taus)
        if other.score < (1.0 - LATE) * choice.score:
            fit, remarks = _fitted(seen, choice := other, unit)
    timing = DelayAndLag(fit.values["delay"], fit.values["lag"])
    prediction = _predicting(fit, choice.grid, timing, seen, observed)
    fit = replace(
        fit,
        model=model.replace(gain=prediction.gain, piezo=prediction.piezo) if model else prediction.piezo,
        observed=observed,
        predict=prediction.predict,
        doubts=tuple(_unexplained(fit, seen)),
        remarks=(
            *choice.remarks,
            *remarks,
            *_left(fit, seen),
            *said_gain(prediction.gain, unit, model and model.gain),
        ),
    )
    return with_scales(fit, found, by_prediction(found, DRIVE))


def _explains_more(seen: Sequence[Observed], choice: Choice, other: Choice) -> bool:
    """Return True if `choice` has a smaller residual over all samples than `other`, and if the ratio of these
    residuals times the ratio of the held-out residuals is below 1. Held-out residuals alone would hide a lag
    after a single edge; the residual of all samples alone would fit hysteresis by a lag."""
    less = left_of_all(seen, choice.late, choice.grid)[0] / left_of_all(seen, other.late, other.grid)[0]
    return less < 1.0 and less * choice.score < other.score


def _fitted(seen: Sequence[Observed], choice: Choice, unit: str) -> tuple[Fit, tuple[str, ...]]:
    """Return the fit of the chosen columns, and sentences on the origin of delay and lag. These are fitted
    with all values if only noise is left; otherwise model errors would bias them: they stay as in
    `choice`."""
    grid, late = choice.grid, choice.late
    if late.edges.number:
        whole = fit_least_squares(_problem(seen, grid, late.timing, unit, timed=True))
        if _only_noise(whole, seen):
            return whole, ()
    return fit_least_squares(_problem(seen, grid, late.timing, unit, timed=False)), late.remarks


def _only_noise(fit: Fit, seen: Sequence[Observed]) -> bool:
    """Return True if no recording's residual exceeds the white noise of its positions."""
    return not _left(fit, seen)


def _left(fit: Fit, seen: Sequence[Observed]) -> tuple[str, ...]:
    """Return a sentence on each recording with a residual above the white noise of its positions."""
    said = (
        more_than_white(
            *(g.rmse, white_noise(one.position), one.position),
            (g.name, g.unit, "positions", "the piezo has another form, or crept before it"),
        )
        for g, one in zip(fit.recordings, seen, strict=True)
    )
    return tuple(filter(None, said))


def _unexplained(fit: Fit, seen: Sequence[Observed]) -> list[str]:
    """Return a sentence on each recording with a residual far above the noise and large in itself.

    A residual above the noise of good sensors alone is only a remark, because real piezos leave it.
    """
    lacking, said = {one.name for one in fit.lack if one.seen}, []
    for g, one in zip(fit.recordings, seen, strict=True):
        white, moved = white_noise(one.position), float(np.std(one.position))
        if g.name not in lacking and g.rmse > max(MANY * white, TOO_LITTLE * moved):
            said.append(
                f"the model does not explain {g.name}: it leaves {100.0 * g.rmse / moved:.3g} % of its "
                f"standard deviation, {g.rmse / white:.3g} x the white noise of its positions"
            )
    return said


def _begun(seen: Sequence[Observed], timing: DelayAndLag, assumed: float | None) -> list[Observed]:
    """Return the recordings with the rest or motion before the first sample that a model without creep shows.
    A rest at another voltage than before is replaced by a rest at `assumed` [V], if given."""
    grid, _, solution = first_model(seen, timing)
    try:
        first = prediction_of(named(solution, grid), grid, timing, seen, "")
    except QuantityError:  # noise exceeds the hysteresis: this rough model does not show the past
        return list(seen)
    found = [first.begun(one) for one in seen]
    if assumed is None:
        return found
    return [
        new if new.cycled or new.begins_as(one) else one._replace(rest=assumed, cycled=False)
        for one, new in zip(seen, found, strict=True)
    ]


def _lateness(seen: Sequence[Observed], delay: float | None, lag: float | None) -> Lateness:
    """Return delay and lag [s] as given (None: 0), or by edges if both are None; QuantityError if below 0."""
    if delay is not None or lag is not None:
        given = DelayAndLag(delay or 0.0, lag or 0.0)
        if min(given) < 0.0:
            raise QuantityError(f"delay = {given.delay:g} s and lag = {given.lag:g} s must be >= 0 s")
        return Lateness(given, ("delay and lag are as given",), Edges((), ()))
    grid, parts, found = first_model(seen, DelayAndLag())
    still = [found.position(c) + o for c, o in zip(parts, found.offsets, strict=True)]
    return lateness(seen, grid, edges_of(seen, still))


def named(found: Solution, grid: PlayGrid) -> Values:
    """Return coefficients by name, SI: weight_1, ..., offset_1, ..., gain; if any, curvature, skew, creep."""
    values = {f"weight_{i}": float(w) for i, w in enumerate(found.weights, start=1)}
    if grid.zones.size:
        values["curvature"] = found.curvature
    if grid.skew:
        values["skew"] = grid.skew
    if grid.times.size:
        values["creep"] = found.creep
    return values | {f"offset_{i}": float(o) for i, o in enumerate(found.offsets, 1)} | {"gain": found.gain}


def _problem(
    seen: Sequence[Observed], grid: PlayGrid, timing: DelayAndLag, unit: str, timed: bool
) -> Problem:
    """Return the least-squares problem of all coefficients; if `timed`, also of delay and lag."""
    found = solved([columns(one, timing, grid) for one in seen], [one.position for one in seen], grid)
    begin = named(found, grid)
    plays = [f"weight_{i}" for i in range(1, grid.thresholds.size + 1)]
    low, high = range_of(seen)
    ends = {"skew": (-0.4 / (high - low), 2.0 / (high - low))}  # below -0.5/range: input not monotonic
    described = _Described(seen, grid, [*plays, *(["curvature"] if grid.zones.size else [])], timed)
    units = {"curvature": f"{unit}/V²", "skew": "1/V", "creep": "", "delay": "s", "lag": "s"}
    reach = {name: 2.0 * begin["gain"] for name in plays} | {"creep": 1.0}
    reach |= {name: max(10.0 * sum(timing), 1e-9) for name in DelayAndLag._fields}
    parameters = [
        Parameter(
            name,
            value,
            *ends.get(name, (0.0 if name in reach else -math.inf, reach.get(name, math.inf))),
            units.get(name, unit if name.startswith("offset") else f"{unit}/V"),
            log=False,
            limits=(0.0, math.inf) if name in reach else None,
        )
        for name, value in (begin | (timing._asdict() if timed else {})).items()
        if name != "gain"
    ]
    fixed = {} if timed else timing._asdict()
    beside = [Parameter("gain", unit=f"{unit}/V", tied=" + ".join(plays))]
    beside += [Parameter(name, value, unit="s", fixed=True) for name, value in fixed.items()]
    recordings = [
        Residuals(described.residuals(i), one.position, None, one.name, unit, _known(one), one.time)
        for i, one in enumerate(seen)
    ]
    return Problem(recordings, [*parameters, *beside], jacobian=described.jacobian, correlated=True)


class _Described:
    """Residuals (model minus measured) and derivatives; caches `Columns` by delay, lag (`timed`) and skew."""

    def __init__(self, seen: Sequence[Observed], grid: PlayGrid, names: Sequence[str], timed: bool) -> None:
        self.seen, self.grid, self.names, self.timed = seen, grid, names, timed
        self.known: dict[tuple[float, ...], list[Columns]] = {}
        self.shifted = [*(["skew"] if grid.skew else []), *(DelayAndLag._fields if timed else ())]

    def parts(self, values: Values) -> list[Columns]:
        """Return the columns of all recordings at the delay, lag and skew in these values."""
        timing, skew = DelayAndLag(values["delay"], values["lag"]), values.get("skew", 0.0)
        if (*timing, skew) not in self.known:
            if len(self.known) > KEPT:
                self.known.clear()
            grid = self.grid.skewed_by(skew)
            self.known[*timing, skew] = [columns(one, timing, grid) for one in self.seen]
        return self.known[*timing, skew]

    def shown(self, values: Values, number: int) -> Array:
        """Return the predicted position of recording `number` (from 0) without offset, m, shape (n,)."""
        part, x = self.parts(values)[number], np.array([values[name] for name in self.names])
        return part.at_once @ x + values.get("creep", 0.0) * (part.crept @ x)

    def residuals(self, number: int) -> Callable[[Values], Array]:
        position = self.seen[number].position

        def of(values: Values) -> Array:
            return self.shown(values, number) + values[f"offset_{number + 1}"] - position

        return of

    def jacobian(self, values: Values) -> Array:
        """Return the derivatives of all residuals, shape (samples, parameters): by weights, curvature, skew,
        creep, offsets, and delay and lag if free; 0 in the last column, for the gain, which is tied."""
        x = np.array([values[name] for name in self.names])
        low, high = range_of(self.seen)
        rows = []
        for i, (part, one) in enumerate(zip(self.parts(values), self.seen, strict=True)):
            now = self.shown(values, i)
            step = dict.fromkeys(DelayAndLag._fields, DIFFERENCE * float(one.time[1]))
            step["skew"] = SKEWED / (high - low)
            by = {
                name: (self.shown({**values, name: values[name] + step[name]}, i) - now) / step[name]
                for name in self.shifted
            }
            slopes = [part.at_once + values.get("creep", 0.0) * part.crept]
            if "skew" in by:
                slopes.append(by.pop("skew")[:, None])
            if "creep" in values:
                slopes.append((part.crept @ x)[:, None])
            offsets = np.zeros((one.time.size, len(self.seen)))
            offsets[:, i] = 1.0
            slopes += [offsets, *(one_by[:, None] for one_by in by.values())]
            rows.append(np.hstack([*slopes, np.zeros((one.time.size, 1))]))
        return np.concatenate(rows)


def _known(observed: Observed) -> KnownNoise:
    """Return where a recording shows its noise: before the drive moves, and between repeated periods."""
    u = observed.drive
    at_rest = first_change(u, MOVED) if observed.rest == u[0] else 0
    return KnownNoise(None, at_rest, repeated(u), resolution(observed.position))


def _predicting(
    fit: Fit, grid: PlayGrid, timing: DelayAndLag, seen: Sequence[Observed], observed: str
) -> PiezoPrediction:
    """Return `prediction_of` a fit. Raises RecordingError if the fitted hysteresis has no inverse."""
    try:
        return prediction_of(fit.values, grid, timing, seen, observed)
    except QuantityError as error:
        raise RecordingError(
            f"{observed} of {', '.join(one.name for one in seen)} does not follow drive_voltage [V] as a "
            f"piezo does: with delay {timing.delay:.3g} s and lag {timing.lag:.3g} s the fit has no inverse "
            f"({error}). Check that both channels are of the same moments, leave delay and lag to the "
            "recordings, or set asymmetric=False or fewer operators"
        ) from error


def prediction_of(
    values: Values, grid: PlayGrid, timing: DelayAndLag, seen: Sequence[Observed], observed: str
) -> PiezoPrediction:
    ends, count = range_of(seen), len(seen)
    weights = np.array([values[f"weight_{i}"] for i in range(1, grid.thresholds.size + 1)])
    gain = values["gain"]
    grid = grid.skewed_by(values.get("skew", 0.0))
    slopes = values.get("curvature", 0.0) * grid.bends / gain
    skews = grid.skew * grid.bends if grid.skew else np.zeros(0)
    rows = (grid.thresholds, weights / gain, grid.zones, slopes, skews)
    hysteresis = PrandtlIshlinskii(*(tuple(row.tolist()) for row in rows))
    count_of_times, creep = grid.times.size, None
    if count_of_times:
        creep = Creep(tuple(grid.times.tolist()), (values["creep"] * distance(grid.times),) * count_of_times)
    offset = float(np.mean([values[f"offset_{i}"] for i in range(1, count + 1)]))
    return PiezoPrediction(Piezo(hysteresis, creep), gain, offset, *timing, *ends, observed)
