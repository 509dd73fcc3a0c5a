"""Public function for the Pareto front of two goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.progress import Progress, unheard
from ..quantities.units import QuantityError, optional_si
from .front import Front, front_of
from .goals import goal_of
from .limits import allowed, frequencies
from .scenarios import Scenario, conditions_of
from .searched import Searched
from .waveforms import check_counts, check_model


def waveform_front(
    model: Actuator,
    *,
    goals: tuple[Any, Any],
    knots: int = 8,
    max_voltage: float | str | None = None,
    min_voltage: float | str | None = None,
    frequency: tuple[float | str, float | str] | None = None,
    output: OutputStage | None = None,
    scenarios: Sequence[Scenario | Mapping[str, Any]] = (),
    points: int = 50,
    generations: int = 80,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = unheard,
) -> Front:
    """Return the Pareto front of two goals: drives for which no other drive is as good in both goals and
    better in one.

    Args:
        goals: two goals, the first of which requires motion, such as ("speed", design.Current("1.4 uF")).
            Each counts in its worst condition.
        points: largest number of points of the front.
        generations: number of generations, each with `points` candidates.
        model, knots, max_voltage, min_voltage, frequency, output, scenarios, seed, threads, progress: as for
            `optimise_waveform`. The output only limits slopes and frequencies: drives are not rounded to its
            updates and do not pass its amplifier.

    Raises:
        QuantityError: there are not two goals, the first one requires no motion, or as for
            `optimise_waveform`.
    """
    low, high = optional_si(min_voltage, "V", "min_voltage"), optional_si(max_voltage, "V", "max_voltage")
    hertz = frequencies(frequency)
    if not isinstance(goals, tuple | list) or len(goals) != 2:
        raise QuantityError(f"goals = {goals!r:.60} must be two")
    both = goal_of(goals[0]), goal_of(goals[1])
    if not both[0].moves:
        raise QuantityError(f"the first goal must ask for motion, which {both[0].label} does not")
    check_model(model)
    check_counts(knots=knots, points=points, generations=generations)
    within_limits = allowed(model, low, high, output, hertz)
    conditions = conditions_of(model, scenarios, None, 1, seed)
    searched = [Searched(model, goal, within_limits, conditions, 0.0, 0.0, threads) for goal in both]
    return front_of(searched, knots, points, generations, seed, progress)
