"""Optimisation of an actuator for a goal: free parameters of the actuator are searched together with its
sawtooth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.progress import Progress, unheard, within
from ..quantities.units import QuantityError, optional_si, unit_for, with_prefix
from ..simulation.varied import free_names
from .built import Built, OptimisedActuator
from .goals import extras_of, goal_of, swings_of
from .limits import Allowed, allowed, frequencies
from .moving import exactly, moved
from .polygons import Array, sawtooths
from .sawtooth import best_sawtooth
from .scenarios import Scenario, ScenarioTable, Uncertainty, conditions_of, own
from .search import SHORTFALL, Index, Judge, Task, robust
from .searched import Searched
from .space import DesignSpace, built, check_conditions, space_of
from .waveforms import check_counts, check_model, check_moves, least_of

# Number of sawtooth coordinates of a candidate (rise, frequency and swing), which precede its free
# parameters.
DRIVE = 3


def optimise_actuator(
    model: Actuator | Mapping[str, Actuator],
    *,
    goal: Any = None,
    free: Mapping[str, Any],
    max_voltage: float | str | None = None,
    min_voltage: float | str | None = None,
    frequency: tuple[float | str, float | str] | None = None,
    output: OutputStage | Mapping[str, OutputStage] | None = None,
    scenarios: Sequence[Scenario | Mapping[str, Any]] = (),
    uncertainty: Uncertainty | None = None,
    draws: int = 64,
    minimum_speed: float | str | None = None,
    holding_force: float | str | None = None,
    budget: int = 1000,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress = unheard,
) -> OptimisedActuator:
    """Search for the free parameters of an actuator, and the sawtooth, that reach a goal best in the worst
    condition.

    Args:
        model: the actuator; or several by name (friction pairs, stacks), each of which is searched.
        goal: "speed", "ripple", "backward_rate", or one of the goals in `stickslip.design`.
        free: free parameters and their ranges, ``{"stage_mass": ("50 g", "200 g"), "load": (0.5, 2)}``:
            fields of actuator and law, "load" (the normal force relative to that of the model's friction), or
            "stage_stiffness". If the stage's mass or stiffness is free, its natural frequency follows from
            both, unless it is free itself; gain and damping ratio are constant unless they are free.
        max_voltage, min_voltage, frequency, scenarios, minimum_speed, threads, progress: as for
            `optimise_waveform`. If a scenario or a draw changes a free parameter, each candidate's value
            changes in the same proportion.
        output: limits of slope, current and frequency, for all models or by the names of the models.
        uncertainty: uncertainty of the model, of which `draws` draws are further conditions; only for a
            single model.
        holding_force: smallest allowed holding force of the contact (Coulomb force times "load"), N, or N m
            for rotary actuators. By default there is no such requirement.
        budget: number of candidates in the search for each model. With several conditions, further rounds
            compute up to half as many, and then, at most three times, up to a sixth.
        seed: seed of the search.

    Returns:
        The best `model` with its `waveform` and `value` (the goal in the worst condition), and in `each` the
        best result of each given model.

    Raises:
        QuantityError: as for `optimise_waveform`; an unknown name, no range or a parameter without effect in
            `free`; a holding force that the ranges do not allow; rotary and linear models together; outputs
            of other models; an uncertainty for several models.
    """
    models = dict(model) if isinstance(model, Mapping) else {"": model}
    if not models:
        raise QuantityError("model = {} has no actuator to choose from")
    for one in models.values():
        check_model(one)
    first, *others = models.values()
    if any(one.rotary != first.rotary for one in others):
        raise QuantityError("model: some turn (rotary = true) and some slide: search each kind alone")
    speed = least_of(minimum_speed, unit_for(first, "m/s"), "minimum_speed")
    hold = least_of(holding_force, unit_for(first, "N"), "holding_force")
    low, high = optional_si(min_voltage, "V", "min_voltage"), optional_si(max_voltage, "V", "max_voltage")
    hertz, aim = frequencies(frequency), goal_of(goal)
    check_counts(budget=budget, draws=draws)
    if others and uncertainty is not None:
        raise QuantityError("uncertainty is that of one actuator: give one model, or scenarios")
    check_moves(first, aim, speed)
    searches = []
    for name, one in models.items():
        if hold and "coulomb_force" not in free_names(one):
            unit, law = unit_for(one, "N"), type(one.friction).__name__
            raise QuantityError(f"holding_force [{unit}]: {law} has no coulomb_force")
        space = space_of(one, free)
        conditions = conditions_of(one, scenarios, uncertainty, draws, seed)
        check_conditions(space, conditions)
        usable = _allowed(space, low, high, _of(output, name, models), hertz)
        searches.append(_Search(name, space, aim, usable, conditions, speed, hold, threads))
    found = []
    for i, search in enumerate(searches):
        found.append(
            search.result(
                budget,
                seed,
                lambda doing, done, i=i: within(progress, i / len(models), 1.0 / len(models), doing, done),
            )
        )
    return OptimisedActuator.of(found, aim)


def _of(output: Any, name: str, models: Mapping[str, Actuator]) -> OutputStage | None:
    """Return the output stage of the model `name`; None: without limits.

    Args:
        output: one stage (or None) for all models, or a mapping of stages by the names of the models.
        name: name of the model.
        models: all models by name.

    Raises:
        QuantityError: the mapping has other names than the models.
    """
    if not isinstance(output, Mapping):
        return output
    if {*output} != {*models}:
        raise QuantityError(f"outputs are of {', '.join(output)}, and the models are {', '.join(models)}")
    return output[name]


def _allowed(
    space: DesignSpace,
    low: float | None,
    high: float | None,
    output: OutputStage | None,
    frequency: tuple[float, float] | None,
) -> Allowed:
    """Return the limits of the drive for all actuators of a design space.

    Voltages and slope are those of the given model. The frequency range covers the given model and the models
    at the lower and at the upper ends of all parameter ranges.

    Args:
        space: free parameters with their ranges.
        low, high: voltage limits, V; None: the model's.
        output: output stage; None: without limits.
        frequency: frequency range (low, high), Hz; None: a range that follows from each model.

    Raises:
        QuantityError: no drive is allowed, see `limits.allowed`.
    """
    models = [space.model, built(space, space.low), built(space, space.high)]
    each = [allowed(model, low, high, output, frequency) for model in models]
    return each[0]._replace(slowest=min(a.slowest for a in each), fastest=max(a.fastest for a in each))


class _Search(NamedTuple):
    """Search for the free parameters of one model and its sawtooth.

    Fields: `name` of the model; `space`, the free parameters; the `goal`; limits `allowed` of the drive;
    `conditions` in which a candidate is judged; required `minimum_speed` [m/s] and `holding_force` [N], 0 for
    none (rad/s and N m for a rotary actuator); number of `threads`; and `scale`, the size of a typical value
    of the goal, by which penalties are multiplied.
    """

    name: str
    space: DesignSpace
    goal: Any
    allowed: Allowed
    conditions: ScenarioTable
    minimum_speed: float
    holding_force: float
    threads: int | None
    scale: float = 1.0

    def result(self, budget: int, seed: int, progress: Progress) -> Built:
        random = np.random.default_rng([seed, 2])
        given = self._searched().scaled(random)
        of, everything = self._replace(scale=given.scale), np.arange(len(self.conditions.names))
        judge = Judge(0.0, None, of.scale)
        saw, spent = best_sawtooth(given.merits_of(sawtooths), judge, everything.size, swings_of(self.goal))
        before, _ = of.exactly(saw, self.space.given)
        count = len(self.space.names)
        starts = [np.append(saw, self.space.shares(self.space.given)), np.append(saw, np.full(count, 0.5))]
        task = Task(
            of.merits,
            judge,
            everything.size,
            budget,
            random,
            lambda doing, done: progress("searching for an actuator", 0.9 * done),
        )
        best = robust(task, np.array([*starts, random.random(DRIVE + count)]))
        found = self.space.values(best.x[None, DRIVE:])[0]
        if self.held(found[None])[0] < 1.0 - 1e-3:
            hold = with_prefix(self.holding_force, unit_for(self.space.model, "N"))
            raise QuantityError(f"holding_force = {hold} is not reached within the ranges of free")
        values, speeds = of.exactly(best.x[:DRIVE], found)
        given.refuse_slow(speeds, self.name)
        progress("searching for an actuator", 1.0)
        return Built(
            self.name,
            self.space,
            found,
            sawtooths(best.x[None, :DRIVE], self.allowed).sawtooth(0),
            self.conditions,
            values,
            speeds,
            before,
            spent + best.evaluations + 2 * everything.size,
            best.interrupted,
        )

    def _searched(self) -> Searched:
        """Return the search for a drive alone (without free parameters of the actuator), for the unchanged
        model with the same goal, limits and conditions."""
        model, conditions = self.space.model, self.conditions
        return Searched(model, self.goal, self.allowed, conditions, self.minimum_speed, 0.0, self.threads)

    def merits(self, x: Array, which: Index) -> Array:
        """Return the merits of candidates, to be maximised, (n, conditions); NaN without a steady motion.

        A merit is the goal's value, with the sign that makes larger values better, minus penalties for a
        speed or a holding force below the required one.

        Args:
            x: candidates (n, 3 + names), each coordinate from 0 to 1: rise, frequency and swing of the
                sawtooth, then the position of each free parameter within its range.
            which: indices of the conditions that are computed.
        """
        shapes, values = sawtooths(x[:, :DRIVE], self.allowed), self.space.values(x[:, DRIVE:])
        columns = self.space.columns(values, self.conditions.part(which))
        ways = moved(self.space.model, shapes, {}, self.threads, columns, extras_of(self.goal))
        found = self._searched()._replace(scale=self.scale).merits(shapes, ways)
        short = np.maximum(1.0 - self.held(values), 0.0)
        return found - SHORTFALL * self.scale * short[:, None]

    def held(self, values: Array) -> Array:
        """Return the ratio of the holding force of each candidate's contact (Coulomb force times "load") to
        the required `holding_force`, shape (n,); infinite if there is no requirement.

        Args:
            values: values of the free parameters, SI, shape (n, names).
        """
        fields, model = self.space.fields(values), self.space.model
        if not self.holding_force:
            return np.full(len(values), np.inf)
        force = fields.get("coulomb_force", np.array(own(model, "coulomb_force")))
        return np.broadcast_to(force * fields.get("load", np.array(1.0)) / self.holding_force, len(values))

    def exactly(self, drive: Array, values: Array) -> tuple[Array, Array]:
        """Return the goal [SI] and the speed [m/s, or rad/s] of one candidate in every condition, an array
        [conditions] each, at the tolerances of a result.

        Args:
            drive: coordinates of the sawtooth (rise, frequency, swing), each from 0 to 1.
            values: values of the free parameters, SI, [names].
        """
        shape = sawtooths(drive[None], self.allowed)
        columns = {n: c[0] for n, c in self.space.columns(values[None], self.conditions.columns).items()}
        # The drive exceeds the voltage limits of the model by rounding errors at most. The simulation refuses
        # even those, so the limits are removed.
        unbound = self.space.model.replace(min_voltage=-math.inf, max_voltage=math.inf)
        ways = exactly(unbound, [shape.one(0)], columns, self.threads, extras_of(self.goal))
        return self.goal.of(shape, ways)[0], ways.steps[0] / shape.period[0]
