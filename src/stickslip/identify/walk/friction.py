"""Fit of an actuator's friction to its own motion: the displacement of the end-effector under a known drive
[kang2007, 5.3]."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import xarray as xr

from ...estimate.blas import single_threaded
from ...estimate.disturbed import with_disturbances
from ...estimate.identifiability import loosest
from ...estimate.marginal import integrated
from ...estimate.parameter import Parameter, Values
from ...estimate.result import Fit
from ...estimate.search import SearchState
from ...estimate.several import followed, lowest
from ...estimate.tied import Ties
from ...estimate.whiteness import white
from ...physics.actuator import Actuator
from ...quantities.progress import Progress, unheard
from ...quantities.units import Coordinate, coordinate_of, optional_si
from ...simulation.varied import free_names, with_values
from ...waveform.signal import Waveform
from ..free import (
    Bounds,
    beside,
    check_motion,
    check_names,
    check_priors,
    known_of,
    parameter,
    said_of,
    with_prior,
)
from ..quantised import Inexact, moved_by, said_steps, with_moved
from ..recorded.at_rest import drift_at_rest
from ..recorded.channels import names_of, recordings_of, unit_of
from ..recorded.drives import taken_drives, warn_of_other_drive
from ..recorded.known_noise import known_noise, said_unjudged
from ..recorded.screen import PositionUnderDrive, driven, refuse_walk
from ..scales import with_scales
from .diagnosis import diagnosed
from .displacement import Displacement, has_slopes
from .first_guess import early_samples
from .guesses import PARTS, from_guesses, initial_guesses, longest
from .needed import freed, freed_near, said_free, said_kept
from .phases import with_other_phases
from .position_channel import CHANNEL, OBSERVED, of_channel, walked, warn_of_unseen_slips
from .prediction import Predictor
from .reaction import with_reaction, with_reaction_asked
from .several import from_points, straightened
from .walks import SETTLED, Walks, own_values

# Smallest rms residual, in converter steps, at which the rounding error acts like white noise and is not
# added to the uncertainty.
DITHERED = 10.0


@single_threaded
def identify_friction(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Actuator,
    free: Sequence[str | Parameter],
    *,
    drive: Waveform | Sequence[Waveform | None] | None = None,
    slew_rate: float | str | None = None,
    stage: Fit | None = None,
    bounds: Bounds | None = None,
    priors: Bounds | None = None,
    tied: Mapping[str, str] | None = None,
    channel: Sequence[str] | None = None,
    initial: Values | None = None,
    noise: float | str | xr.Dataset | None = None,
    starts: int = 1,
    hops: int = 6,
    seed: int = 0,
    tolerance: float | str | None = None,
    correlated: bool | None = None,
    averaged: bool = True,
    loss: str = "linear",
    loss_scale: float = 1.0,
    settled: float = SETTLED,
    max_evaluations: int = 200,
    diagnose: bool = True,
    progress: Progress = unheard,
    each: Callable[[SearchState], None] | None = None,
) -> Fit:
    """Fit an actuator to recordings of its end-effector's position (raw samples), all recordings at once.

    Every recording is simulated from rest, so its first sample must be at rest.

    The recordings may hardly determine one parameter of the actuator. If derivatives exist, the result is
    then averaged over all its plausible values, and the intervals of the other parameters allow for these
    (see `marginal`). If the model leaves out that friction acts back on the stage, `failures` or `remarks`
    report whether the recordings contradict that (see `reaction`).

    Args:
        recordings: with end_effector_position [m]; or [rad], for a rotary actuator: then forces in the model
            are torques [N m], and masses are moments of inertia [kg m^2]. Also with drive_voltage [V] unless
            `drive` is given.
        model: the actuator; its values are one of several initial guesses (see `first_guess`), and the fit
            describes the recordings no worse than they do.
        free: parameters to fit: scalar fields of the law ("sigma_0", "coulomb_force", ...; "stiffness_2" of a
            second element) and of the actuator ("end_effector_mass", "gain", ...); "stiction_ratio" (stiction
            over Coulomb friction) and "breakaway_share" (breakaway deflection over Coulomb force / sigma_0),
            whose bounds are numbers while those of the fields depend on each other; and of the position
            channel, one for all recordings, "delay" [s] and "offset" [m]. Stiction and breakaway deflection
            that are not free keep their ratio. Each is a name, or a `Parameter` with its initial value,
            bounds and prior in SI, fixed or tied, for example from another fit (``fit.parameters``).
        drive: waveform of each recording (or one for all), in the time of the recording. By default, or None:
            the one that the recording names or its channel drive_voltage shows (see `taken_drive`), else that
            channel, with its jumps as far as the samples show them (see `recorded_drive`).
        slew_rate: rate at which the amplifier follows the jumps of drive_voltage, V/s, as its current limit
            into the piezo sets it. By default jumps are instantaneous; a fit then mistakes a slower jump for
            more friction.
        stage: fit of `identify_step` for the model's stage: its uncertainty is added to the result.
        bounds: lower and upper bound of free parameters by name, in SI or as strings; others are searched
            within a factor 30 of the initial guess first, and then as far as the law allows: no interval ends
            at a default bound.
            The scale is logarithmic, but linear towards zero, and where bounds reach down to zero.
        priors: independent knowledge of free parameters: value and standard deviation of each, in SI or as
            strings. They need a given noise.
        tied: parameters that follow from others, which may be free, tied or neither: the expression of each
            by name, such as ``{"sigma_1": "0.2 * sqrt(sigma_0 * end_effector_mass)"}``; see `estimate.tied`.
        channel: names of the free parameters of the position channel, "delay" and "offset"; () for neither.
            By default those that the recordings show: an offset at rest, or a parameter that lowers the sum
            of squares by more than noise does; `remarks` of the fit name them.
        initial: initial values of "delay" and "offset" by name, SI; by default the delay of the fit `stage`,
            or 0.
        noise: standard deviation of the position, m (rad); by default estimated from the residuals. Or a
            recording of the channel at rest: then only its drift is used, which a short walk does not show;
            the drift widens the uncertainty.
        starts: number of initial guesses; those after the first fill the bounds.
        hops: see `fit_least_squares`. With 0 the search uses only the given initial values and looks for no
            other local minimum; the reaction on the stage is then not tested.
        seed: seed of the further initial guesses.
        tolerance: error tolerance of the simulated position, m (rad); by default 1e-10 for a law of one
            internal state without jumps, on a dynamic stage, whose derivatives are those of `sensitivities`.
            For other models the derivatives are differences over 0.05 % of a parameter. The tolerance must be
            far below their effect (for a weakly determined parameter some pm in steps of micrometres), so the
            default is 1e-12.
        correlated: True: the uncertainty allows for any residuals correlated in time. By default, if the
            noise is not given, it allows for noise that is correlated over some samples and for a random walk
            (a sensor's drift), as far as the residuals show them (see `coloured`).
        averaged: False: give a weakly determined value at the lowest sum of squares, with intervals from the
            curvature there.
        loss, loss_scale: see `fit_least_squares`: "soft_l1" or "huber" for recordings with outliers; the
            scale is in m unless the noise is given.
        settled: see `fit_least_squares`.
        max_evaluations: largest number of evaluations of all recordings with derivatives, for each initial
            guess; evaluations for numerical derivatives are additional. A model that still explains little
            after 30 s of CPU is abandoned; `failures` say so.
        diagnose: if the model does not explain a recording, search for the missing term; `advice` of the fit,
            and a remark, name it. It takes at most some 20 s of CPU time.
        progress, each: called after each evaluation; see `fit_least_squares`.

    Returns:
        A fit whose `model` is the actuator with the fitted values, and whose ``predict(recording,
        drive=None)`` simulates a recording.

    Raises:
        RecordingError: a channel is missing, empty, constant, clipped, too short or too coarsely sampled;
            the position is noise, of the wrong sign or size, or swapped with the drive; or numbers do not
            match.
        QuantityError: a name that cannot be free, bounds that do not fit, priors without a noise, a drive out
            of range.
        FitError: see `fit_least_squares`.

    Warns:
        RecordingWarning: the drive comes from a drive_voltage whose samples do not resolve its jumps; a walk
            is sampled more coarsely than the stage vibrates; or drive_voltage differs from the given drive
            for a whole period.
    """
    slew_rate = optional_si(slew_rate, "V/s", "slew_rate")
    found = recordings_of(recordings)
    unit, level, drift = _noise(noise, found)
    tolerance = optional_si(tolerance, unit or "m", "tolerance")
    check_motion(model, unit)
    names, (found, drives) = names_of(found), taken_drives(found, drive, slew_rate)
    first = ({"delay": stage.values["delay"]} if stage is not None else {}) | (initial or {})
    along = coordinate_of(unit)
    of_chain = {"delay": (first.get("delay", 0.0), "s"), "offset": (first.get("offset", 0.0), unit)}
    known = known_of(model, of_chain, along)
    free, bounds, priors, tied, starting = said_of(free, known, bounds, priors, tied)
    _check(model, free, bounds, priors, level)
    first |= {name: starting.pop(name) for name in CHANNEL if name in starting}
    model = with_values(model, starting) if starting else model
    measured = [walked(r, w, name) for r, w, name in zip(found, drives, names, strict=True)]
    for r, x, w, name in zip(found, measured, drives, names, strict=True):
        refuse_walk(PositionUnderDrive(name, OBSERVED, unit, r["time"].values, x, driven(r, w, name)), model)
        warn_of_unseen_slips(r, model, name)
        warn_of_other_drive(r, w, name)
    tolerance = tolerance or (1e-10 if has_slopes(model) else 1e-12)

    parameters = partial(_parameters, model, found, bounds, priors, first, along)
    others = beside(free, tied, known_of(model, of_chain, along))
    walks = Walks(
        [
            Displacement(r, w, name, model, tolerance, slew_rate)
            for r, w, name in zip(found, drives, names, strict=True)
        ],
        measured,
        names,
        unit,
        [known_noise(r, x, w)._replace(drift=drift) for r, x, w in zip(found, measured, drives, strict=True)],
        model,
        stage,
        Ties([*parameters(free), *others]),
        level,
        correlated,
        loss,
        loss_scale,
        seed,
        progress,
        each,
        settled,
    )

    taken = {*free, *(p.name for p in walks.ties.beside if p.tied)}

    def searched(free: Sequence[str]) -> Fit:
        return _searched(walks, parameters(free), bounds, starts, hops, max_evaluations)

    def near(free: Sequence[str], fit: Fit) -> Fit:
        return _near(walks, parameters(free), fit, bounds, max_evaluations)

    asked: list[str] = []
    if channel is not None:
        fit = searched([*free, *(name for name in channel if name not in taken)])
    elif hops:
        fit, asked = freed(searched, near, walks, free, taken, first)
    else:
        fit, asked = freed_near(searched, walks, free, taken, first)
    going = not walks.budget.over
    if averaged and going:
        given = {p.name: p.start for p in parameters([p.name for p in fit.parameters])}
        fit = _averaged(walks, fit, given, max_evaluations)
    if asked:
        fit = replace(fit, remarks=(*fit.remarks, said_free(fit, asked)))
    reacting = with_reaction(fit, walks, max_evaluations) if hops and going else None
    fit = with_reaction_asked(fit, reacting)
    fit = _completed(walks.budget.told(fit), walks, slew_rate, tolerance)
    fit = with_scales(fit, found, walks.by_known, stage)
    if not (diagnose and going):
        return fit

    def afar(of: Walks, parameters: list[Parameter], own: Bounds) -> Fit:
        return from_guesses(of, parameters, {**bounds, **own}, max_evaluations)

    return diagnosed(fit, walks, reacting, afar)


def _noise(
    noise: float | str | xr.Dataset | None, found: Sequence[xr.Dataset]
) -> tuple[str, float | None, float]:
    """Return the unit of the positions ("m" or "rad"), the given standard deviation of their noise in this
    unit (None if not given), and the drift at rest (variance gained per sample; 0 without a recording at
    rest)."""
    if isinstance(noise, xr.Dataset):
        return unit_of([*found, noise], OBSERVED), None, drift_at_rest(noise, OBSERVED, found)
    unit = unit_of(found, OBSERVED)
    return unit, optional_si(noise, unit or "m", "noise"), 0.0


def _parameters(
    model: Actuator,
    found: Sequence[xr.Dataset],
    bounds: Bounds,
    priors: Bounds,
    first: Values,
    along: Coordinate,
    free: Sequence[str],
) -> list[Parameter]:
    """Return the `free` parameters of the actuator and the position channel, with bounds and priors; `first`
    contains initial delay and offset by name, `along` is the coordinate of the motion (length or angle)."""
    own = [
        of_channel(name, found, bounds, first) if name in CHANNEL else parameter(model, name, bounds, along)
        for name in free
    ]
    return [with_prior(p, priors) for p in own]


def _check(model: Actuator, free: Sequence[str], bounds: Bounds, priors: Bounds, noise: float | None) -> None:
    """Raise QuantityError unless the model (or the channel) has all free parameters, all bounds and priors
    belong to them, and the noise is given if there are priors."""
    own = {name: limits for name, limits in bounds.items() if name not in CHANNEL}
    check_priors(priors, free, noise, "[m], the position's deviation")
    check_names(free, [*free_names(model), *CHANNEL], own)


def _completed(fit: Fit, walks: Walks, slew_rate: float | None, tolerance: float) -> Fit:
    """Return the fit with the uncertainty from converter steps added, and with `model`, `predict`, further
    remarks and the search for instrument faults (`disturbances`)."""
    measured = walks.measured
    simulated = np.concatenate(fit.residuals) + np.concatenate(measured)
    known = [
        Inexact(x, one.step if of.rmse < DITHERED * one.step else 0.0)
        for x, one, of in zip(measured, walks.known, fit.recordings, strict=True)
    ]
    moved = moved_by(known, lambda drawn: simulated - np.concatenate(drawn))
    fit = with_moved(fit, moved, said_steps(OBSERVED, known, walks.unit))
    model = with_values(walks.model, own_values(fit.values))._replace(rotary=walks.unit == "rad")
    unjudged = said_unjudged(fit.lack, fit.residuals, measured, walks.unit)
    remarks = (*fit.remarks, *said_kept(fit, walks.model), *unjudged)
    predict = Predictor.of(model, fit.values, slew_rate, tolerance).predict
    fit = replace(fit, model=model, observed=OBSERVED, predict=predict, remarks=remarks)
    return with_disturbances(fit)


def _searched(
    walks: Walks,
    parameters: list[Parameter],
    bounds: Bounds,
    starts: int,
    hops: int,
    max_evaluations: int,
) -> Fit:
    """Return the best fit of searches from the user's initial guess and, if `hops` is above 0, from guesses
    by simulation and at other stiffnesses. `starts` is the number of guesses, the further ones random."""
    own, guesses = parameters, [{p.name: p.start for p in parameters}]
    walk = longest(walks)
    if hops:
        parameters, found = initial_guesses(walks, own, bounds, early_samples(walk.time, walk.waveform))
        guesses += found
    fit = from_points(walks, parameters, guesses, bounds, max_evaluations)
    if walks.budget.over:
        return fit
    if hops and not (_white(fit) and not any(one.seen for one in fit.lack)):
        # The first periods of a walk may not distinguish local minima, so these guesses use all its samples.
        parameters, found = initial_guesses(walks, own, bounds, walk.time.size, PARTS)
        fit = lowest([fit, from_points(walks, parameters, found, bounds, max_evaluations)])
    if walks.budget.over:
        return fit
    fit = with_other_phases(fit, walks, max_evaluations) if hops else fit
    if starts > 1 or (hops and not _white(fit)):
        straight = straightened(fit.parameters, fit.values)
        fit = lowest([fit, walks.fit(straight, max_evaluations=max_evaluations, starts=starts, hops=hops)])
        fit = with_other_phases(fit, walks, max_evaluations) if hops else fit
    return fit


def _near(
    walks: Walks, parameters: Sequence[Parameter], fit: Fit, bounds: Bounds, max_evaluations: int
) -> Fit:
    """Return the best fit of `parameters` by searches from their initial values and from the minima of `fit`,
    a fit with more parameters. `bounds` are the user's bounds by name, which stay."""
    given = {p.name: p.start for p in parameters}
    own = [p.starting_at(given[p.name])._replace(power=0) for p in fit.parameters if p.name in given]
    there = [fit.values, *(m.values for m in fit.minima)]
    guesses = [given, *({name: one[name] for name in given} for one in there)]
    return from_points(walks, own, guesses, bounds, max_evaluations)


def _white(fit: Fit) -> bool:
    return white(np.concatenate(fit.residuals), [r.size for r in fit.residuals])


def _averaged(walks: Walks, fit: Fit, given: Values, max_evaluations: int) -> Fit:
    """Return the fit averaged over the plausible values of the least determined parameter; unchanged if all
    parameters are well determined, the loss is robust, or the law has no derivatives.

    If the averaged values describe the recordings worse than the user's initial values `given`, the values
    stay at the lowest sum of squares, and only the intervals are about the mean.
    """
    parameters = list(fit.parameters)
    name = loosest(fit, CHANNEL) if has_slopes(walks.model) and walks.loss == "linear" else None
    if name is None:
        return fit
    settled = integrated(fit, name, partial(walks.hold, name, parameters, max_evaluations))
    if not isinstance(settled, Fit):
        on = walks.fit(straightened(parameters, settled), max_evaluations=max_evaluations)
        return lowest([_at_end(walks, fit, max_evaluations), on])
    if settled.cost > walks.cost(given):
        fit = _at_end(walks, fit, max_evaluations)
        return replace(fit, uncertainty=settled.uncertainty._replace(centre=settled.coordinates))
    return replace(settled, jacobian=walks.problem(parameters).by_coordinates(settled.values))


def _at_end(walks: Walks, fit: Fit, max_evaluations: int) -> Fit:
    """Return the fit; if its search was stopped on the way along a curved minimum, the search is first
    continued to the end."""
    there = straightened(fit.parameters, fit.values)
    return followed(fit, lambda: walks.fit(there, max_evaluations=max_evaluations))
