"""Searches over simulated walks: all recordings at once, or with one value fixed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...estimate.budget import EvaluationBudget
from ...estimate.coloured import with_inherited, with_own_noise
from ...estimate.fit import fit_least_squares
from ...estimate.lack import KnownNoise
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import Problem, Residuals
from ...estimate.result import Fit
from ...estimate.search import SearchState
from ...estimate.tied import Ties
from ...physics.actuator import Actuator
from ...quantities.progress import Progress
from ...simulation.varied import with_values
from ..free import exchangeable, value_of
from ..recorded.known_noise import white_noise
from ..scales import DRIVE, ByKnown
from ..step.fit import STAGE_PARAMETERS
from .displacement import Displacement, has_slopes
from .position_channel import CHANNEL

# Relative, of a law without derivatives. With its tolerance, both parts of the error are under 1 % of a
# derivative. A contact that rings on between jumps shows a tenth of a percent of its stiffness as another
# phase: over steps of 5e-3, the derivative by a stiffness is wrong by a quarter.
DIFFERENCE_STEP = 5e-4
# See `fit_least_squares`. Errors of simulated derivatives leave some thousandths anywhere; two hundredths
# raise chi-squared by less than searches that agree differ in (`SAME_MINIMUM`). Of the average over fits
# where one value is fixed, a tenth is far less.
SETTLED, NEAR = 2e-2, 0.1

Array = NDArray[np.float64]


class Varied:
    """An actuator with values put in, and what is tied to them; the last is kept, for it is asked for again
    at once."""

    def __init__(self, model: Actuator, ties: Ties | None = None) -> None:
        self.model, self.ties, self._last = model, ties or Ties(()), ({}, model)

    def __call__(self, values: Values) -> Actuator:
        own = own_values(self.ties(values))
        if own != self._last[0]:
            self._last = (own, with_values(self.model, own))
        return self._last[1]


@dataclass(frozen=True)
class Walks:
    """Recordings of one actuator: their simulations, the positions [m] that were measured, their names, the
    unit of the positions and what they show of their noise; the fit that the stage is from, if any; what is
    tied to the parameters of fits, which have only those that are searched for; the rest as
    `identify_friction`."""

    motions: Sequence[Displacement]
    measured: Sequence[Array]
    names: Sequence[str]
    unit: str
    known: Sequence[KnownNoise]
    model: Actuator
    stage: Fit | None
    ties: Ties
    noise: float | None
    correlated: bool | None
    loss: str
    loss_scale: float
    seed: int
    progress: Progress
    each: Callable[[SearchState], None] | None
    settled: float = SETTLED
    spent: EvaluationBudget | None = None
    varied: Varied = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "varied", Varied(self.model, self.ties))
        if self.spent is None:
            white = [white_noise(x) for x in self.measured]
            object.__setattr__(self, "spent", EvaluationBudget.of(self.measured, white, self.noise or 1.0))

    @property
    def budget(self) -> EvaluationBudget:
        """What all searches of these recordings share, with other models too."""
        assert self.spent is not None
        return self.spent

    def fit(self, parameters: Sequence[Parameter], **options: Any) -> Fit:
        """See `searched` and `completed`."""
        return self.completed(self.searched(parameters, **options))

    def beside(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """What is fixed or tied beside the parameters of a fit."""
        names = {p.name for p in parameters}
        return [p for p in self.ties.beside if p.name not in names]

    def cost(self, values: Values) -> float:
        """The weighted sum of squares at the values; infinite where there is no model."""
        try:
            parts = [
                observed(m, self.varied, values) - x for m, x in zip(self.motions, self.measured, strict=True)
            ]
        except (ValueError, ArithmeticError):
            return math.inf
        return float(sum(r @ r for r in parts)) / (self.noise or 1.0) ** 2

    def hold(
        self, name: str, parameters: Sequence[Parameter], most: int, value: float, begin: Values
    ) -> tuple[Fit, Fit]:
        """The fit of the others with one value fixed, without the uncertainty of the stage and with it."""
        fixed = [
            p._replace(start=value, fixed=True) if p.name == name else p.starting_at(begin[p.name])
            for p in parameters
        ]
        alone = self._with_noise(self.searched(fixed, max_evaluations=most, settled=NEAR))
        return alone, self._with_stage(alone)

    def problem(self, parameters: Sequence[Parameter]) -> Problem:
        """Of what the position channel shows; with what is tied to the parameters."""
        parameters = [*parameters, *self.beside(parameters)]
        free = [p.name for p in parameters if not p.fixed]
        own, exact = [name for name in free if name not in CHANNEL], has_slopes(self.model)
        varied = self.varied

        def residuals(motion: Displacement, position: Array) -> Callable[[Values], Array]:
            def of(values: Values) -> Array:
                if (
                    exact
                ):  # most trial points are accepted, and then want their slopes: one simulation for both
                    motion.slopes(varied(values), values.get("delay", 0.0), own)
                return observed(motion, varied, values) - position

            return of

        return Problem(
            [
                Residuals(
                    residuals(motion, position), position, self.noise, name, self.unit, known, motion.time
                )
                for motion, position, name, known in zip(
                    self.motions, self.measured, self.names, self.known, strict=True
                )
            ],
            parameters,
            jacobian=slopes_of(self.motions, varied, free) if exact else None,
            noise_known=self.noise is not None,
            correlated=bool(self.correlated),
            loss=self.loss,
            loss_scale=self.loss_scale,
            difference_step=DIFFERENCE_STEP,
            exchangeable=exchangeable(self.model.friction, parameters, self.ties.beside),
        )

    def searched(
        self,
        parameters: Sequence[Parameter],
        *,
        max_evaluations: int,
        settled: float | None = None,
        **options: Any,
    ) -> Fit:
        """By least squares; see `completed`."""
        problem = self.problem(parameters)
        problem.budget = self.budget
        # A slope by differences is an evaluation for each free value.
        each = 1 if problem.jacobian else 1 + len(parameters)
        return fit_least_squares(
            problem,
            seed=self.seed,
            progress=self.progress,
            each=self.each,
            settled=settled or self.settled,
            max_evaluations=max_evaluations * each,
            **options,
        )

    def completed(self, fit: Fit) -> Fit:
        """The fit with the noise that is seen in what it leaves, and with the uncertainty of the stage."""
        return self._with_stage(self._with_noise(fit))

    def _with_noise(self, fit: Fit) -> Fit:
        # Noise that was given is not that of a clock that jitters.
        own = self.noise is None or any(one.independent for one in fit.jitter)
        if self.correlated is None and own and self.loss == "linear":
            fit = with_own_noise(fit)
        return fit

    def _with_stage(self, fit: Fit) -> Fit:
        """The fit with the uncertainty of the stage passed on, of those of its values that are not free."""
        stage = self.stage
        if stage is None:
            return fit
        kept = stage_beside(stage, fit)
        if not kept:
            return fit
        names = [stage.parameters[i].name for i in kept]
        here = replace(fit, model=with_values(self.model, own_values(fit.values)))
        by = position_slopes(self.motions, here, names)
        slopes = [stage.parameters[i].slope(stage.values[n]) for i, n in zip(kept, names, strict=True)]
        return with_inherited(fit, by * slopes, stage.uncertainty.covariance[np.ix_(kept, kept)])

    def by_known(self, fit: Fit) -> ByKnown:
        """Derivatives of all residuals of a completed fit by what it takes as known: see `with_scales`.

        The scale of the drive acts as the gain does.
        """
        stage = self.stage
        kept = [] if stage is None else [stage.parameters[i] for i in stage_beside(stage, fit)]
        names = list(dict.fromkeys(["gain", *(p.name for p in kept)]))
        by = dict(zip(names, position_slopes(self.motions, fit, names).T, strict=True))
        of_stage = {p.name: by[p.name] * p.slope(stage.values[p.name]) for p in kept} if stage else {}
        return ByKnown({DRIVE: fit.model.gain * by["gain"]}, of_stage)


def stage_beside(stage: Fit, fit: Fit) -> list[int]:
    """Where in the fit of a stage those of its values stand that a fit of friction took as known."""
    own = {p.name for p in (*fit.parameters, *fit.beside) if not p.fixed}
    return [i for i, p in enumerate(stage.parameters) if p.name in STAGE_PARAMETERS and p.name not in own]


def own_values(values: Values) -> Values:
    """The values that are of the actuator."""
    return {name: value for name, value in values.items() if name not in CHANNEL}


def observed(motion: Displacement, varied: Varied, values: Values) -> Array:
    """What the position channel shows for values of the actuator and of the channel [m]."""
    values = varied.ties(values)
    return motion.position(varied(values), values.get("delay", 0.0)) + values.get("offset", 0.0)


def slopes_of(
    motions: Sequence[Displacement], varied: Varied, free: Sequence[str]
) -> Callable[[Values], Array]:
    """Derivatives of all recordings' residuals by the free values, [samples, free]."""
    own = [name for name in free if name not in CHANNEL]

    def of(values: Values) -> Array:
        here, delay = varied(values), values.get("delay", 0.0)
        found = np.concatenate([motion.slopes(here, delay, own) for motion in motions])
        known = {name: found[:, i] for i, name in enumerate([*own, "delay"])}
        known["offset"] = np.ones(len(found))
        return np.column_stack([known[name] for name in free])

    return of


def columns_of(motion: Displacement, fit: Fit, names: Sequence[str]) -> dict[str, Array]:
    """Derivatives [samples] of one position by each value alone: by those named, by what is tied in the fit,
    and by the channel's."""
    model, delay = fit.model, fit.values.get("delay", 0.0)
    names = [name for name in dict.fromkeys([*names, *fit.tied]) if name not in CHANNEL]
    if has_slopes(model):
        by = motion.slopes(model, delay, names).T
    else:
        late = -np.gradient(motion.position(model, delay), motion.time)
        by = [*(_difference(motion, model, delay, name) for name in names), late]
    return dict(zip([*names, "delay"], by, strict=True)) | {"offset": np.ones(motion.time.size)}


def by_values(columns: Mapping[str, Array], fit: Fit, names: Sequence[str]) -> Array:
    """Derivatives [samples, names] by values that a fit took as known, with what is tied to them."""
    known = {name: getattr(fit.model, name) for name in names}
    return fit.ties.follow(columns, {**known, **fit.values}, names)


def by_coordinates(columns: Mapping[str, Array], fit: Fit) -> Array:
    """Derivatives [samples, k] by the coordinates of a fit."""
    slopes = [p.slope(fit.values[p.name]) for p in fit.parameters]
    return fit.ties.follow(columns, fit.values, [p.name for p in fit.parameters]) * slopes


def position_slopes(motions: Sequence[Displacement], fit: Fit, names: Sequence[str]) -> Array:
    """Derivatives of all positions, joined, [samples, names]; see `by_values`."""
    return np.concatenate([by_values(columns_of(m, fit, names), fit, names) for m in motions])


def _difference(motion: Displacement, model: Actuator, delay: float, name: str) -> Array:
    """Derivative of a position by a value of the model, where no exact one is to be had."""
    value, _ = value_of(model, name)
    sides = [
        motion.position(with_values(model, {name: value * (1.0 + h)}), delay)
        for h in (-DIFFERENCE_STEP, DIFFERENCE_STEP)
    ]
    return (sides[1] - sides[0]) / (2.0 * DIFFERENCE_STEP * value)
