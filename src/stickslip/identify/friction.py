"""Friction parameters of an actuator from its own motion: the displacement of the end-effector under a known
drive [kang2007, 5.3]."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..actuator import Actuator
from ..simulation.varied import free_names, with_values
from ..waveform.signal import Waveform
from .channels import channel, names_of, recordings_of, refuse_clipped, same_number
from .coloured import coloured, with_coloured_noise, with_inherited
from .displacement import Displacement, has_slopes
from .drives import refuse_sampling
from .first_guess import beginning, beside, first_guess
from .fit import Progress, Residuals, fit_least_squares
from .free import Bounds, check_names, parameter
from .identifiability import loosest
from .marginal import integrated
from .result import Fit, Parameter, Values
from .step_fit import STAGE
from .whiteness import white

OBSERVED = "end_effector_position"
# Relative, of a law without derivatives. With its tolerance, both parts of its error are under 1 % of a
# derivative; a step of 1e-4 needs a tolerance of 1e-13 m for that, for which the simulation takes longer.
DIFFERENCE_STEP = 5e-3
# Relative, of the sum of squares, where one value is held: far below what noise explains.
NEAR = 1e-5
# Evaluations after which a search that creeps along a value that is not determined is left to `integrated`.
ENOUGH = 30
# Of the channel, not of the actuator.
CHANNEL = ("delay", "offset")
# m, and steps, of the simulations that only tell where to begin.
GUESS_TOLERANCE, GUESS_STEPS = 1e-9, 20_000
# A delay is looked for within this share of the shortest recording.
LONGEST_DELAY = 0.02


def identify_friction(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Actuator,
    free: Sequence[str],
    *,
    drive: Waveform | Sequence[Waveform | None] | None = None,
    slew_rate: float | None = None,
    stage: Fit | None = None,
    bounds: Bounds | None = None,
    begin: Values | None = None,
    noise: float | None = None,
    starts: int = 1,
    hops: int = 6,
    seed: int = 0,
    tolerance: float | None = None,
    correlated: bool | None = None,
    loss: str = "linear",
    loss_scale: float = 1.0,
    max_evaluations: int = 200,
    progress: Callable[[Progress], None] | None = None,
) -> Fit:
    """Fit an actuator to recordings of its end-effector's position, raw samples, all recordings at once.

    Every recording is described by a simulation from rest, so its first sample must be at rest.

    If the recordings hardly determine one value of the actuator, and derivatives are known, that value is
    given at its mean over all that fits, and the intervals of the others hold for all of that
    (see `marginal`).

    Args:
        recordings: with end_effector_position [m].
        model: the actuator; its values are one start of many (see `first_guess`).
        free: what to fit: scalar fields of the law ("sigma_0", "coulomb_force", ...; "stiffness_2" of a
            second element) and of the actuator ("end_effector_mass", "gain", ...); "stiction_ratio" (stiction
            over Coulomb friction) and "breakaway_share" (of the Coulomb deflection), which are bounded where
            the fields themselves are not; and of the position channel, one for all recordings, "delay" [s]
            and "offset" [m]. Stiction and breakaway deflection that are not free keep their ratio.
        drive: waveform of each recording (one: of all), in the time of the recording. Left out, or None: the
            channel drive_voltage from the recording's first sample on, with its jumps as far as the samples
            show them (see `recorded_drive`).
        slew_rate: V/s at which the amplifier follows the jumps of drive_voltage: the current limit into the
            piezo. Left out, at once; a fit then takes the slower jump for more friction.
        stage: the fit of `identify_step` that the model's stage is from: its uncertainty is passed on to what
            is fitted here.
        bounds: of free parameters, in SI or as strings; else a factor 30 either side of the start, and of the
            one that is found for sigma_0, sigma_1 and coulomb_force. The scale is logarithmic, but linear
            where bounds reach down to zero.
        begin: where "delay" and "offset" start; left out, at the delay of the stage, or 0.
        noise: standard deviation of the position, m; left out, it is estimated from the residuals.
        starts: how many; those after the first fill the bounds.
        hops: see `fit_least_squares`; 0 looks for no start and no other valley: for a start that is near.
        seed: of the further starts.
        tolerance: m, of the simulation; left out, 1e-10 for a law of one internal state, whose derivatives
            are those of `sensitivities`. For the others they are differences over half a percent of a
            parameter, so it must be far below what that changes (a weakly determined one: some pm in steps of
            micrometres): 1e-12.
        correlated: True: allow for residuals correlated in time in the uncertainty, whatever they are. Left
            out, for noise that is correlated over some samples and for a random walk (a sensor's drift), as
            far as the residuals show them (see `coloured`), where the noise is not given.
        loss, loss_scale: see `fit_least_squares`: "soft_l1" or "huber" for recordings with outliers; the
            scale is in m unless the noise is given.
        max_evaluations: of all recordings, for each start.
        progress: called after each evaluation.

    Returns:
        A fit whose `model` is the actuator with the values put in, and whose ``predict(recording,
        drive=None)`` simulates a recording.

    Raises:
        RecordingError: a channel is missing, empty, constant, clipped, too short or too coarsely sampled, or
            numbers do not match.
        QuantityError: a name that cannot be free, bounds that do not fit, a drive out of range.
        FitError: see `fit_least_squares`.

    Warns:
        RecordingWarning: a drive_voltage whose samples do not show its jumps stood in for the waveform.
    """
    found = recordings_of(recordings)
    names = names_of(found)
    # A waveform is a tuple too, so it is known by its method.
    given: Any = [drive] * len(found) if hasattr(drive, "drive") else drive
    drives = same_number(given, found, "drives")
    bounds = bounds or {}
    check_names(free, [*free_names(model), *CHANNEL], bounds)
    measured = [walked(r, w, name) for r, w, name in zip(found, drives, names, strict=True)]
    shifts = {
        "delay": LONGEST_DELAY * min(float(np.ptp(r["time"].values)) for r in found),
        "offset": max(float(np.ptp(m) + abs(m[0])) for m in measured),
    }
    first = ({"delay": stage.values["delay"]} if stage is not None else {}) | (begin or {})
    parameters = [
        _of_channel(name, shifts[name], bounds, first) if name in CHANNEL else parameter(model, name, bounds)
        for name in free
    ]
    exact = has_slopes(model)
    tolerance = tolerance or (1e-10 if exact else 1e-12)
    motions = [
        Displacement(r, w, name, model, tolerance, slew_rate)
        for r, w, name in zip(found, drives, names, strict=True)
    ]

    wide = parameters
    if hops:
        stroke = max(motion.stroke(model) for motion in motions)
        most = int(np.argmax([np.ptp(position) for position in measured]))
        part = beginning(found[most], drives[most])
        short = Displacement(part, drives[most], names[most], model, GUESS_TOLERANCE, slew_rate, GUESS_STEPS)
        position = measured[most][: short.time.size]
        wide = first_guess(
            Residuals(lambda v: observed(short, model, v) - position, position, noise, names[most], "m"),
            _slopes([short], model, free) if exact else None,
            parameters,
            model,
            stroke,
            bounds,
        )

    def search(start: Actuator, parameters: Sequence[Parameter], **options: Any) -> Fit:
        def residuals(motion: Displacement, position: NDArray[np.float64]) -> Any:
            return lambda values: observed(motion, start, values) - position

        fit = fit_least_squares(
            [
                Residuals(residuals(motion, position), position, noise, name, "m")
                for motion, position, name in zip(motions, measured, names, strict=True)
            ],
            parameters,
            jacobian=_slopes(motions, start, [p.name for p in parameters]) if exact else None,
            noise_known=noise is not None,
            correlated=bool(correlated),
            loss=loss,
            loss_scale=loss_scale,
            seed=seed,
            difference_step=DIFFERENCE_STEP,
            progress=progress,
            **options,
        )
        if correlated is None and noise is None and loss == "linear":
            fit = with_coloured_noise(fit, coloured(fit.residuals, walks=True))
        return fit

    def hold(name: str, value: float, begin: Values) -> tuple[Fit, Fit]:
        start = with_values(model, {name: value})
        others = [p._replace(start=begin[p.name]) for p in parameters if p.name != name]
        alone = search(start, others, max_evaluations=max_evaluations, tolerance=NEAR)
        return alone, alone if stage is None else _with_stage(alone, motions, start, stage)

    def whole(parameters: Sequence[Parameter], **options: Any) -> Fit:
        fit = search(model, parameters, **options)
        return fit if stage is None else _with_stage(fit, motions, model, stage)

    thorough = {"starts": starts, "hops": hops, "max_evaluations": max_evaluations}
    quick = thorough | {"hops": 0, "max_evaluations": min(ENOUGH, max_evaluations)}
    fit = whole(wide, **quick)
    if hops and not fit.converged and loosest(fit, _own(fit.values)) is None:  # still far from where it leads
        on = [p._replace(start=fit.values[p.name]) for p in wide]
        fit = whole(on, **thorough | {"hops": 0})
    parameters = at = beside(parameters, fit.values, bounds)
    fit = replace(fit, parameters=tuple(parameters))
    if not white(np.concatenate(fit.residuals), [r.size for r in fit.residuals]):
        fit = whole(at, **thorough)
    loose = loosest(fit, _own(fit.values)) if exact and loss == "linear" else None
    if loose is not None:
        settled = integrated(fit, loose, partial(hold, loose))
        if isinstance(settled, Fit):
            slopes = [p.slope(settled.values[p.name]) for p in parameters]
            fit = replace(settled, jacobian=_slopes(motions, model, free)(settled.values) * slopes)
        else:
            fit = whole([p._replace(start=settled[p.name]) for p in parameters], **thorough)
    elif not fit.converged:
        fit = whole(at, **thorough)

    def predict(recording: xr.Dataset, drive: Waveform | None = None) -> NDArray[np.float64]:
        name = names_of([recording])[0]
        return observed(Displacement(recording, drive, name, model, tolerance, slew_rate), model, fit.values)

    return replace(fit, model=with_values(model, _own(fit.values)), observed=OBSERVED, predict=predict)


def walked(recording: xr.Dataset, drive: Waveform | None, where: str) -> NDArray[np.float64]:
    """The positions of a walk, m.

    Raises:
        RecordingError: they are missing, empty, constant, clipped, too few or too coarsely sampled.
    """
    position = channel(recording, OBSERVED, where, varies=True)
    refuse_clipped(position, OBSERVED, where)
    refuse_sampling(recording["time"].values, drive, where)
    return position


def _with_stage(fit: Fit, motions: Sequence[Displacement], model: Actuator, stage: Fit) -> Fit:
    """The fit with the uncertainty of the stage passed on, of those of its values that are not free here."""
    kept = [i for i, p in enumerate(stage.parameters) if p.name in STAGE and p.name not in fit.values]
    if not kept:
        return fit
    names = [stage.parameters[i].name for i in kept]
    here, delay = with_values(model, _own(fit.values)), fit.values.get("delay", 0.0)
    if has_slopes(here):
        by = np.vstack([m.slopes(here, delay, names)[:, :-1] for m in motions])
    else:
        by = np.column_stack([_difference(motions, here, delay, name) for name in names])
    slopes = np.array([stage.parameters[i].slope(stage.values[n]) for i, n in zip(kept, names, strict=True)])
    return with_inherited(fit, by * slopes, stage.uncertainty.covariance[np.ix_(kept, kept)])


def _difference(
    motions: Sequence[Displacement], model: Actuator, delay: float, name: str
) -> NDArray[np.float64]:
    """Derivative of all positions by a value of the model, where no exact one is to be had."""
    value = getattr(model, name)
    sides = [
        np.concatenate([m.position(with_values(model, {name: value * (1.0 + h)}), delay) for m in motions])
        for h in (-DIFFERENCE_STEP, DIFFERENCE_STEP)
    ]
    return (sides[1] - sides[0]) / (2.0 * DIFFERENCE_STEP * value)


def _of_channel(name: str, reach: float, bounds: Bounds, begin: Values) -> Parameter:
    unit = "s" if name == "delay" else "m"
    low, high = (float(limit) for limit in bounds.get(name, (-reach, reach)))
    return Parameter(name, min(max(begin.get(name, 0.0), low), high), low, high, unit, log=False)


def _own(values: Values) -> Values:
    """The values that are of the actuator."""
    return {name: value for name, value in values.items() if name not in CHANNEL}


def observed(motion: Displacement, model: Actuator, values: Values) -> NDArray[np.float64]:
    """What the position channel shows for values of the actuator and of the channel [m]."""
    position = motion.position(with_values(model, _own(values)), values.get("delay", 0.0))
    return position + values.get("offset", 0.0)


def _slopes(
    motions: Sequence[Displacement], model: Actuator, free: Sequence[str]
) -> Callable[[Values], NDArray[np.float64]]:
    """Derivatives of all recordings' residuals by the free values, [samples, free]."""
    own = [name for name in free if name not in CHANNEL]

    def of(values: Values) -> NDArray[np.float64]:
        here, delay = with_values(model, _own(values)), values.get("delay", 0.0)
        found = np.vstack([motion.slopes(here, delay, own) for motion in motions])
        known = {name: found[:, i] for i, name in enumerate([*own, "delay"])}
        known["offset"] = np.ones(len(found))
        return np.column_stack([known[name] for name in free])

    return of
