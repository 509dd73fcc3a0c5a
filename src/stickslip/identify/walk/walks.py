"""Least-squares fit of an actuator's values to walks, all recordings at once, and derivatives of the
positions."""

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

# Relative step of parameters for numerical derivatives, for laws without exact ones. With a simulation
# tolerance of 1e-12 m, truncation and simulation errors are each below 1 % of a derivative. Larger steps are
# wrong if the contact vibrates between jumps, because the phase then depends strongly on the stiffness: with
# 5e-3, the derivative by the stiffness is wrong by a quarter.
DIFFERENCE_STEP = 5e-4
# Convergence limits: a search ends if its next step is shorter than this share of the radius of the
# confidence region. Errors of simulated derivatives alone cause steps of some thousandths. SETTLED raises
# chi-squared by less than the difference between searches that agree (`SAME_MINIMUM`). NEAR is accurate
# enough for averages over fits with one value fixed, and for comparisons of residuals.
SETTLED, NEAR = 2e-2, 0.1

Array = NDArray[np.float64]


class Varied:
    """A function from fitted values (by name, SI) to the actuator with these values and the values tied to
    them; the last result is cached.

    Args:
        model: actuator with initial values, of which the others stay.
        ties: expressions of tied values; None: no values are tied.
    """

    def __init__(self, model: Actuator, ties: Ties | None = None) -> None:
        self.model, self.ties, self._last = model, ties or Ties(()), ({}, model)

    def __call__(self, values: Values) -> Actuator:
        own = own_values(self.ties(values))
        if own != self._last[0]:
            self._last = (own, with_values(self.model, own))
        return self._last[1]


@dataclass(frozen=True)
class Walks:
    """Recordings of one actuator as a least-squares problem.

    Attributes:
        motions: simulation of each recording.
        measured: measured positions of each recording, m (rad).
        names: names of the recordings.
        unit: unit of the positions, "m" or "rad".
        known: noise of each recording that is known independently of the residuals.
        model: actuator with initial values.
        stage: fit of the stage, whose uncertainty is added; None: the stage is exact.
        ties: expressions of tied parameters, and the fixed values in them.
        noise: given standard deviation of the positions, m (rad); None: estimated.
        settled: convergence limit, see `SETTLED`.
        spent: evaluation budget, shared with copies of this problem for other models.
        varied: function that returns the actuator for fitted values.

    The other fields are arguments of `identify_friction`.
    """

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
        """Return the computing budget that all searches for these recordings share, also searches with other
        models."""
        assert self.spent is not None
        return self.spent

    def fit(self, parameters: Sequence[Parameter], **options: Any) -> Fit:
        """Search the minimum of the sum of squares and return the fit with its uncertainty; `options` are
        those of `searched`."""
        return self.completed(self.searched(parameters, **options))

    def beside(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Return the fixed and tied parameters that a fit of `parameters` needs, except those in
        `parameters`."""
        names = {p.name for p in parameters}
        return [p for p in self.ties.beside if p.name not in names]

    def cost(self, values: Values) -> float:
        """Return the sum of squared residuals of all walks at these values (by name, SI), divided by the
        squared given noise, or in m^2 (rad^2) without a given noise; infinite if the model cannot be
        simulated."""
        try:
            parts = [
                observed(m, self.varied, values) - x for m, x in zip(self.motions, self.measured, strict=True)
            ]
        except (ValueError, ArithmeticError):
            return math.inf
        return float(sum(r @ r for r in parts)) / (self.noise or 1.0) ** 2

    def hold(
        self, name: str, parameters: Sequence[Parameter], most: int, value: float, initial: Values
    ) -> tuple[Fit, Fit]:
        """Return the fit of all other parameters with the named one fixed at `value`, twice: without and with
        the uncertainty from the stage.

        Args:
            name: name of the fixed parameter.
            parameters: all free parameters, including the named one.
            most: largest number of evaluations with derivatives.
            value: value of the fixed parameter, SI.
            initial: initial guess of the others by name, SI.
        """
        fixed = [
            p._replace(start=value, fixed=True) if p.name == name else p.starting_at(initial[p.name])
            for p in parameters
        ]
        alone = self._with_noise(self.searched(fixed, max_evaluations=most, settled=NEAR))
        return alone, self._with_stage(alone)

    def problem(self, parameters: Sequence[Parameter]) -> Problem:
        """Return the least-squares problem of these parameters, with those fixed or tied to them, for the
        positions of all walks."""
        parameters = [*parameters, *self.beside(parameters)]
        free = [p.name for p in parameters if not p.fixed]
        own, exact = [name for name in free if name not in CHANNEL], has_slopes(self.model)
        varied = self.varied

        def residuals(motion: Displacement, position: Array) -> Callable[[Values], Array]:
            def of(values: Values) -> Array:
                if exact:  # one simulation gives position and derivatives; accepted points need both
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
        """Search the minimum of the sum of squares and return the fit. Its uncertainty is that of white noise
        with an exact stage (and of any correlated residuals, if so requested); `completed` adds the rest.

        Args:
            parameters: parameters with initial values and bounds.
            max_evaluations: largest number of evaluations with derivatives.
            settled: convergence limit; None: the field `settled`.
            options: further arguments of `fit_least_squares`.
        """
        problem = self.problem(parameters)
        problem.budget = self.budget
        # `max_evaluations` counts evaluations with derivatives. Numerical derivatives take one further
        # evaluation for each parameter.
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
        """Return the fit with the uncertainty from correlated noise added, as far as the residuals show it,
        and that from the values of the stage that the fit took as known."""
        return self._with_stage(self._with_noise(fit))

    def _with_noise(self, fit: Fit) -> Fit:
        # Noise is estimated from the residuals if it is not given, or with clock jitter, which a given noise
        # does not include.
        own = self.noise is None or any(one.independent for one in fit.jitter)
        if self.correlated is None and own and self.loss == "linear":
            fit = with_own_noise(fit)
        return fit

    def _with_stage(self, fit: Fit) -> Fit:
        """Return the fit with the uncertainty of the stage's values added, as far as the fit took them as
        known (linearised)."""
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
        """Return the derivatives of all residuals of a completed fit by the quantities that it takes as
        known, for `with_scales`: the drive's scale, which has the same effect as the gain, and the stage's
        values."""
        stage = self.stage
        kept = [] if stage is None else [stage.parameters[i] for i in stage_beside(stage, fit)]
        names = list(dict.fromkeys(["gain", *(p.name for p in kept)]))
        by = dict(zip(names, position_slopes(self.motions, fit, names).T, strict=True))
        of_stage = {p.name: by[p.name] * p.slope(stage.values[p.name]) for p in kept} if stage else {}
        return ByKnown({DRIVE: fit.model.gain * by["gain"]}, of_stage)


def stage_beside(stage: Fit, fit: Fit) -> list[int]:
    """Return the indices in `stage`, the fit of the stage, of the stage parameters that `fit`, a fit of
    friction, took as known."""
    own = {p.name for p in (*fit.parameters, *fit.beside) if not p.fixed}
    return [i for i, p in enumerate(stage.parameters) if p.name in STAGE_PARAMETERS and p.name not in own]


def own_values(values: Values) -> Values:
    """Return the values by name without delay and offset, which belong to the channel and not to the
    actuator."""
    return {name: value for name, value in values.items() if name not in CHANNEL}


def observed(motion: Displacement, varied: Varied, values: Values) -> Array:
    """Return the simulated samples of the position channel, m (rad), shape (n,), for values of the actuator
    and of the channel (delay, offset) by name, SI; tied values follow. `motion` simulates the recording, and
    `varied` is the model with its varied values."""
    values = varied.ties(values)
    return motion.position(varied(values), values.get("delay", 0.0)) + values.get("offset", 0.0)


def slopes_of(
    motions: Sequence[Displacement], varied: Varied, free: Sequence[str]
) -> Callable[[Values], Array]:
    """Return a function that takes values by name, SI, and returns the derivatives of the residuals of all
    recordings by the values named in `free`, SI, shape (samples of all recordings, free). Tied values count
    as independent. `motions` simulate the recordings; `varied` is as for `observed`."""
    own = [name for name in free if name not in CHANNEL]

    def of(values: Values) -> Array:
        here, delay = varied(values), values.get("delay", 0.0)
        found = np.concatenate([motion.slopes(here, delay, own) for motion in motions])
        known = {name: found[:, i] for i, name in enumerate([*own, "delay"])}
        known["offset"] = np.ones(len(found))
        return np.column_stack([known[name] for name in free])

    return of


def columns_of(motion: Displacement, fit: Fit, names: Sequence[str]) -> dict[str, Array]:
    """Return the derivatives of one recording's position at a fit, SI, shape (samples,), in a dictionary by
    the name of the value: the given names, all tied values, delay and offset.

    A tied value counts as independent here; `by_values` adds the ties.
    """
    model, delay = fit.model, fit.values.get("delay", 0.0)
    names = [name for name in dict.fromkeys([*names, *fit.tied]) if name not in CHANNEL]
    if has_slopes(model):
        by = motion.slopes(model, delay, names).T
    else:
        late = -np.gradient(motion.position(model, delay), motion.time)
        by = [*(_difference(motion, model, delay, name) for name in names), late]
    return dict(zip([*names, "delay"], by, strict=True)) | {"offset": np.ones(motion.time.size)}


def by_values(columns: Mapping[str, Array], fit: Fit, names: Sequence[str]) -> Array:
    """Return the derivatives of a position by values that a fit took as known, shape (samples, names),
    including the effect of values tied to them; `columns` come from `columns_of`."""
    known = {name: getattr(fit.model, name) for name in names}
    return fit.ties.follow(columns, {**known, **fit.values}, names)


def by_coordinates(columns: Mapping[str, Array], fit: Fit) -> Array:
    """Return the derivatives of a position by the k search coordinates q of a fit's parameters (such as
    logarithms of values), shape (samples, k), including the effect of tied values; `columns` come from
    `columns_of`."""
    slopes = [p.slope(fit.values[p.name]) for p in fit.parameters]
    return fit.ties.follow(columns, fit.values, [p.name for p in fit.parameters]) * slopes


def position_slopes(motions: Sequence[Displacement], fit: Fit, names: Sequence[str]) -> Array:
    """Return the derivatives of the positions of all walks by values that a fit took as known, SI, shape
    (samples of all walks, names)."""
    return np.concatenate([by_values(columns_of(m, fit, names), fit, names) for m in motions])


def _difference(motion: Displacement, model: Actuator, delay: float, name: str) -> Array:
    """Return the derivative of the simulated position `motion`, at this delay [s], by the named value of the
    model (not 0), SI, shape (samples,), as a central difference, for models without exact derivatives."""
    value, _ = value_of(model, name)
    sides = [
        motion.position(with_values(model, {name: value * (1.0 + h)}), delay)
        for h in (-DIFFERENCE_STEP, DIFFERENCE_STEP)
    ]
    return (sides[1] - sides[0]) / (2.0 * DIFFERENCE_STEP * value)
