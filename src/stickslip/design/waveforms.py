"""Public function for the best drive signal within limits, under all given conditions; and checks of the
arguments of searches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..estimate.posterior import Posterior
from ..estimate.result import Fit
from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.progress import Progress, unheard
from ..quantities.records import Quantity
from ..quantities.units import QuantityError, optional_si, to_si, unit_for
from .goals import goal_of
from .limits import allowed, frequencies
from .optimised import OptimisedWaveform
from .scenarios import Scenario, Uncertainty, conditions_of
from .searched import Searched

COUNTS = {
    "knots": (2, 64),
    "draws": (1, 100_000),
    "budget": (1, 10_000_000),
    "points": (4, 1000),
    "generations": (1, 1_000_000),
}


def optimise_waveform(
    model: Actuator | Fit,
    *,
    goal: Any = None,
    knots: int = 8,
    max_voltage: float | str | None = None,
    min_voltage: float | str | None = None,
    frequency: tuple[float | str, float | str] | None = None,
    output: OutputStage | None = None,
    scenarios: Sequence[Scenario | Mapping[str, Any]] = (),
    uncertainty: Uncertainty | None = None,
    draws: int = 64,
    quantile: float | str = 0.0,
    minimum_speed: float | str | None = None,
    budget: int = 2400,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = unheard,
) -> OptimisedWaveform:
    """Search for the periodic drive that reaches a goal best, and compare it with the best sawtooth.

    A drive is a polygon through values at equidistant times of its period; values and frequency are found by
    differential evolution and CMA-ES. It is judged by its steady motion in the worst of all conditions: the
    unchanged model, each scenario, and both with the values of each draw.

    Args:
        model: the actuator; or a fit of one, whose covariance is then the `uncertainty`.
        goal: "speed", "ripple", "backward_rate", or one of the goals in `stickslip.design`.
        knots: number of values within a period.
        max_voltage, min_voltage: V; by default those of the model (from 0 V if it has no minimum).
        frequency: range (low, high), Hz; by default around the stage's natural frequency, and the frequency
            at which friction can just accelerate the end-effector over the stroke.
        output: limits of slope and current, amplifier and updates. With an update rate, the period is a whole
            number of updates, and the output of the converter counts.
        scenarios: further conditions, such as loads or detuning; see `Scenario`.
        uncertainty: posterior, fit, or arrays by name, of which `draws` draws are further conditions.
        quantile: quantile over the conditions, such as 0.05, instead of the worst.
        minimum_speed: m/s, in every condition (or at the quantile), towards +x or in the direction of the
            goal; required by goals that are best without motion.
        budget: number of candidates in the first search. With several conditions, further rounds compute up
            to half as many, and then, at most three times, up to a sixth.
        seed: seed of search and draws.
        threads: number; by default all processors.
        progress: called during the search.

    Returns:
        The `waveform`, its `value`, and a comparison with the best sawtooth in every condition. It is worse
        in none of them: if no better drive was found, it is the sawtooth, and `fell_back` is True.

    Raises:
        QuantityError: no goal, an unknown name in a scenario or in the uncertainty, or an unsuitable model or
            number; limits that exclude every drive, no drive with a steady motion, or no drive that reaches
            the minimum speed; or the package cma is not installed.
    """
    model, uncertainty = _model_of(model, uncertainty)
    speed = least_of(minimum_speed, unit_for(model, "m/s"), "minimum_speed")
    low, high = optional_si(min_voltage, "V", "min_voltage"), optional_si(max_voltage, "V", "max_voltage")
    share, hertz = to_si(quantile, "", "quantile"), frequencies(frequency)
    aim = goal_of(goal)
    check_counts(knots=knots, draws=draws, budget=budget)
    if not 0.0 <= share < 1.0:
        raise QuantityError(f"quantile = {share:g} is out of range: it must be >= 0 (the worst) and < 1")
    check_moves(model, aim, speed)
    within_limits = allowed(model, low, high, output, hertz)
    conditions = conditions_of(model, scenarios, uncertainty, draws, seed)
    searched = Searched(model, aim, within_limits, conditions, speed, share, threads)
    return searched.result(knots, budget, seed, progress)


def _model_of(model: Any, uncertainty: Uncertainty | None) -> tuple[Actuator, Uncertainty | None]:
    """Return the actuator of `model`, which may be a fit; and the given uncertainty, or else the fit.

    Raises:
        QuantityError: `model` is a posterior or no actuator, or it cannot step (see `check_model`).
    """
    if isinstance(model, Fit):
        found, uncertainty = model.model, uncertainty or model
    elif isinstance(model, Posterior):
        raise QuantityError(
            "a posterior says how uncertain an actuator is: give model=, uncertainty=posterior"
        )
    else:
        found = model
    check_model(found)
    return found, uncertainty


def check_model(model: Any) -> None:
    """Raise QuantityError unless `model` is an actuator whose end-effector is not clamped to the stage."""
    if not isinstance(model, Actuator):
        raise QuantityError(f"model = {model!r:.60} must be an actuator, or the fit of one")
    if model.clamped:
        raise QuantityError("a clamped end-effector does not step: give a model with clamped=False")


def least_of(value: float | str | None, unit: str, field: str) -> float:
    """Return a required minimum (speed or force) in SI; 0 if the `value` is None.

    Args:
        value: number in SI, or text with a unit.
        unit: SI unit of the quantity.
        field: name of the argument in errors.

    Raises:
        QuantityError: the value is negative or has another unit.
    """
    return 0.0 if value is None else Quantity(unit, "", "it", minimum=0).check(value, field)


def check_moves(model: Actuator, goal: Any, speed: float) -> None:
    """Raise QuantityError if neither the goal nor a minimum `speed` above 0 requires motion: the best drive
    for such a goal (least current, say) would be a constant voltage. `model` gives the unit in the
    message."""
    if not goal.moves and not speed > 0.0:
        unit = unit_for(model, "m/s")
        raise QuantityError(
            f"minimum_speed [{unit}] is needed: with the least {goal.label} alone, nothing would move"
        )


def check_counts(**given: int) -> None:
    """Raise QuantityError if an argument, given by its name ("knots", "budget", ...), is not a whole number
    within its range in `COUNTS`."""
    for name, value in given.items():
        least, most = COUNTS[name]
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise QuantityError(
                f"{name} = {value!r} is out of range: it must be a whole number from {least} to {most}"
            )
