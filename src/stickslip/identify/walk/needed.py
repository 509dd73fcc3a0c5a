"""Decision whether a fit frees delay and offset of the position channel, if the user does not say so."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ...estimate.lack import KnownNoise
from ...estimate.parameter import Values
from ...estimate.result import Fit
from ...estimate.score import ASKED, gain, rise
from ...physics.actuator import Actuator
from ...simulation.varied import ratios_of
from ..free import value_of
from .position_channel import CHANNEL
from .walks import Walks

# FEWEST: fewest samples at rest for a test of their mean position. SURE: size of this mean, in standard
# errors, above which an offset is fitted.
FEWEST, SURE = 10, 4.0
# Largest ratio of the sums of squares without and with free delay and offset at which the linearised test at
# the fit without them is used.
FAR = 2.0

Array = NDArray[np.float64]


def shown_at_rest(known: Sequence[KnownNoise], measured: Sequence[Array]) -> list[str]:
    """Return ["offset"] if the mean position before the motion differs significantly from zero in any
    recording; otherwise an empty list.

    Args:
        known: noise of each recording, with its number of samples at rest and its converter step.
        measured: positions of each recording, m (rad), [n].
    """
    for noise, position in zip(known, measured, strict=True):
        rest = position[: noise.at_rest]
        if rest.size >= FEWEST:
            least = noise.step / math.sqrt(12.0) + 1e-6 * float(np.ptp(position))
            error = max(float(rest.std(ddof=1)), least) / math.sqrt(rest.size)
            if abs(float(rest.mean())) > SURE * error:
                return ["offset"]
    return []


def freed(
    searched: Callable[[Sequence[str]], Fit],
    near: Callable[[Sequence[str], Fit], Fit],
    walks: Walks,
    free: Sequence[str],
    taken: Collection[str],
    first: Values,
) -> tuple[Fit, list[str]]:
    """Fit with delay and offset free as far as the recordings require them.

    Both are free in the first search: without a real offset, the sum of squares has additional minima in
    which searches end.

    Args:
        searched: function that takes names of parameters and fits them from distant initial guesses.
        near: function that takes names of parameters and a fit with more parameters, and fits the named ones,
            starting from the minima of the given fit.
        walks: recordings to describe.
        free: names of the other free parameters.
        taken: names that are free or tied already.
        first: given initial values by name; a delay or offset among them is always free.

    Returns:
        The fit, and the names of the channel parameters that were freed.
    """
    others = [name for name in CHANNEL if name not in taken]
    asked = [name for name in others if name in shown_at_rest(walks.known, walks.measured)]
    whole = searched([*free, *others])
    if walks.budget.over:
        return whole, others
    if asked != others:
        less = near([*free, *asked], whole)
        # Far from the minimum, the linearised test suggests whichever parameter resembles the missing one.
        # Then parameters stay free whose removal from the fit with both would raise chi-squared.
        if less.cost > FAR * whole.cost:
            more = [name for name in others if name in first or rise(whole, name) > ASKED] or others
        else:
            more = _asked_for(less, walks, first, {*taken, *asked})
        if not more:
            return less, asked
        asked = [name for name in others if name in (*asked, *more)]
    return whole if asked == others else near([*free, *asked], whole), asked


def freed_near(
    searched: Callable[[Sequence[str]], Fit],
    walks: Walks,
    free: Sequence[str],
    taken: Collection[str],
    first: Values,
) -> tuple[Fit, list[str]]:
    """Fit like `freed`, for an initial guess near the minimum: delay and offset are fixed at first, except an
    offset that the samples at rest show, and are freed if the recordings require them. The arguments are
    those of `freed`.

    Returns:
        The fit, and the names of the channel parameters that were freed.
    """
    asked = [name for name in shown_at_rest(walks.known, walks.measured) if name not in taken]
    fit = searched([*free, *asked])
    more = [] if walks.budget.over else _asked_for(fit, walks, first, {*taken, *asked})
    if more:
        asked = [name for name in CHANNEL if name in (*asked, *more)]
        fit = searched([*free, *asked])
    return fit, asked


def _asked_for(fit: Fit, walks: Walks, first: Values, free: Collection[str]) -> list[str]:
    """Return those of the names "delay" and "offset", not in `free`, that have a given initial value in
    `first` or would lower chi-squared by more than chance, linearised at `fit`."""
    pairs = zip(fit.residuals, walks.measured, walks.motions, strict=True)
    moving = [-np.gradient(r + x, motion.time) for r, x, motion in pairs]
    slopes = {"delay": np.concatenate(moving), "offset": np.ones(sum(x.size for x in walks.measured))}
    return [
        name for name in CHANNEL if name not in free and (name in first or gain(fit, slopes[name]) > ASKED)
    ]


def said_free(fit: Fit, names: Sequence[str]) -> str:
    """Return a sentence with the names and fitted values of channel parameters that were freed
    automatically."""
    units = {p.name: p for p in fit.parameters}
    listed = " and ".join(f"{name} = {units[name].shown(fit.values[name], 3)}" for name in names)
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)} of the position channel {verb} free too, for the recordings show: {listed}"


def said_kept(fit: Fit, model: Actuator) -> tuple[str, ...]:
    """Return a tuple with one sentence if Coulomb friction was fitted and stiction stayed in a fixed ratio to
    Coulomb friction, other than 1, as in `model`; otherwise an empty tuple."""
    free = {"stiction_force", "stiction_ratio"} & {*fit.values, *fit.tied}
    if free or "coulomb_force" not in fit.values or "stiction_ratio" not in ratios_of(model.friction):
        return ()
    ratio = value_of(model, "stiction_ratio")[0]
    if abs(ratio - 1.0) < 1e-9:
        return ()
    return (
        f"stiction_force was not free: it is {ratio:.4g} times coulomb_force, as in the model that was given",
    )
