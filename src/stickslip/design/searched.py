"""Search for the drive that reaches one goal best: first the best sawtooth, then the best polygon, and the
better of both."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..physics.actuator import Actuator
from ..quantities.progress import Progress, within
from ..quantities.units import QuantityError, unit_for, with_prefix
from ..waveform.signal import Waveform
from .goals import direction_of, extras_of, swings_of
from .limits import Allowed
from .moving import PeriodicMotions, exactly, moved
from .optimised import OptimisedWaveform
from .polygons import Array, Polygons, knots, sawtooths, starts
from .sawtooth import best_sawtooth
from .scenarios import ScenarioTable
from .search import DOING, SHORTFALL, Best, Index, Judge, Task, robust

# Both are relative to the scale of the goal. MARGIN: margin above the best sawtooth that a search demands in
# every condition, because the tolerance of the search is coarser than that of the result, and because the
# drive is then rounded to updates of the output. NO_WORSE: largest shortfall of the result below the sawtooth
# that counts as equal.
MARGIN, NO_WORSE = 1e-3, 1e-6
# Largest shortfall below the minimum speed, relative to the minimum speed, that is accepted.
NEAR = 1e-3
# Number of random sawtooths whose largest goal defines the scale of a goal.
SAMPLES = 48


class Searched(NamedTuple):
    """Search for the drive that reaches one goal best.

    Fields: `model`, the actuator; `goal`; `allowed` ranges of the drive; `conditions` in which drives are
    judged; `minimum_speed` in the direction of the goal, m/s, or rad/s for a rotary actuator, 0 for none;
    `quantile` over the conditions (0: the worst); number of `threads` (None: all processors); and `scale`,
    the size of a typical value of the goal, by which penalties are multiplied.
    """

    model: Actuator
    goal: Any
    allowed: Allowed
    conditions: ScenarioTable
    minimum_speed: float
    quantile: float
    threads: int | None
    scale: float = 1.0

    def result(self, count: int, budget: int, seed: int, progress: Progress) -> OptimisedWaveform:
        """Search for the best sawtooth and the best drive, and return the better of both.

        Args:
            count: number of knots of the drive.
            budget: number of candidates in the first search.
            seed: seed of the search.
            progress: called with activity and finished fraction.

        Raises:
            QuantityError: no sawtooth or drive has a steady motion, or the minimum speed is not reached.
        """
        random = np.random.default_rng([seed, 1])
        of = self.scaled(random)
        everything = len(of.conditions.names)
        swings = swings_of(self.goal)
        x, spent = best_sawtooth(
            of.merits_of(sawtooths), Judge(of.quantile, None, of.scale), everything, swings
        )
        sawtooth = sawtooths(x[None], of.allowed)
        progress(DOING, 0.1)
        baseline = of.merits_of(sawtooths)(x[None], np.arange(everything))[0]
        judge = Judge(of.quantile, np.nan_to_num(baseline, nan=-np.inf) + MARGIN * of.scale, of.scale)
        task = Task(
            of.merits_of(knots),
            judge,
            everything,
            budget,
            random,
            lambda doing, done: within(progress, 0.1, 0.85, doing, done),
        )
        best = robust(task, starts(sawtooth, count, of.allowed))
        made = replace(of.chosen(best, sawtooth, spent), interrupted=best.interrupted)
        progress(DOING, 1.0)
        return made

    def scaled(self, random: np.random.Generator) -> Searched:
        """Return the search with its `scale`: the largest magnitude of the goal over random sawtooths, for
        the unchanged model.

        Raises:
            QuantityError: none of them has a steady motion, or the goal is 0 with all of them.
        """
        shapes = sawtooths(random.random((SAMPLES, 2)), self.allowed)
        found = np.abs(self.goal.of(shapes, self.moved(shapes, {})))
        found = found[np.isfinite(found)]
        if not found.size or not found.max() > 0.0:
            raise QuantityError(
                f"no sawtooth of {self.allowed.low:g} V to {self.allowed.high:g} V at "
                f"{self.allowed.slowest:g} Hz to {self.allowed.fastest:g} Hz moves this actuator "
                "periodically: give other limits"
            )
        return self._replace(scale=float(found.max()))

    def merits_of(self, family: Any) -> Any:
        """Return a function that computes merits [n, conditions] from search points [n, coordinates] and
        indices of conditions. `family` makes drives from the points: `polygons.knots` or
        `polygons.sawtooths`."""

        def found(x: Array, which: Index) -> Array:
            shapes = family(x, self.allowed)
            return self.merits(shapes, self.moved(shapes, self.conditions.part(which)))

        return found

    def moved(self, shapes: Polygons, columns: Mapping[str, Array]) -> PeriodicMotions:
        """Return the periodic motions under drives, shape (n, conditions), with the results that the goal
        needs.

        `columns` are the values of the model's fields in each condition by name, as for
        `design.moving.moved`.
        """
        return moved(self.model, shapes, columns, self.threads, extras=extras_of(self.goal))

    def merits(self, shapes: Polygons, moved: PeriodicMotions) -> Array:
        """Return the merits of drives with their periodic motions, to be maximised, shape (n, conditions).

        A merit is the goal's value, with the sign that makes larger values better, minus a penalty in
        proportion to the shortfall below the minimum speed.
        """
        merits = self.goal.sign * self.goal.of(shapes, moved)
        if self.minimum_speed:
            speeds = direction_of(self.goal) * moved.steps / shapes.period[:, None]
            short = np.maximum(self.minimum_speed - speeds, 0.0)
            merits = merits - SHORTFALL * self.scale * short / self.minimum_speed
        return merits

    def refuse_slow(self, speeds: Array, name: str = "") -> None:
        """Raise QuantityError if the worst speed, or the speed at the quantile, is below the minimum speed.

        Args:
            speeds: speeds in all conditions, m/s, or rad/s for a rotary actuator.
            name: name of the actuator in the message, if there are several.
        """
        if not self.minimum_speed:
            return
        reached = float(np.quantile(direction_of(self.goal) * speeds, self.quantile))
        if not reached >= self.minimum_speed * (1.0 - NEAR):
            unit = unit_for(self.model, "m/s")
            raise QuantityError(
                f"minimum_speed = {with_prefix(self.minimum_speed, unit)} is not reached"
                f"{f' by {name}' if name else ''}: what comes nearest moves at {with_prefix(reached, unit)}"
            )

    def chosen(self, best: Best, sawtooth: Polygons, spent: int) -> OptimisedWaveform:
        """Return the result of the search: the best drive as the converter outputs it, or the sawtooth if the
        drive is worse than the sawtooth in any condition or has a lower score.

        Both are computed again at the tolerances of a result, with periods of a whole number of updates.

        Args:
            best: result of the search for `knots`.
            sawtooth: best sawtooth, a single polygon.
            spent: number of periodic motions computed for the sawtooth.

        Raises:
            QuantityError: no drive has a steady motion in every condition, or the minimum speed is not
                reached.
        """
        found = knots(best.x[None], self.allowed)
        candidates, saws = self.at_updates(found), self.at_updates(sawtooth)
        shapes = [*candidates, *saws]
        drives: list[Waveform] = [shape.one(0) for shape in shapes]
        played = self.played(drives)
        at_piezo = self.at_piezo(played)
        # The drive exceeds the voltage limits of the model by rounding errors at most. The simulation refuses
        # even those, so the limits are removed.
        unbound = self.model.replace(min_voltage=-math.inf, max_voltage=math.inf)
        found = exactly(unbound, at_piezo, self.conditions.columns, self.threads, extras_of(self.goal))
        merits = np.concatenate([self.merits(shape, found.of(i)) for i, shape in enumerate(shapes)])
        judge, everything = Judge(self.quantile, None, self.scale), np.arange(merits.shape[1])
        scores = judge.score(merits, everything)
        n = len(candidates)
        saw = n + int(np.argmax(scores[n:]))
        if np.isnan(merits[saw]).any() and not np.isfinite(scores[:n]).any():
            raise QuantityError("no drive was found that has a steady motion in every condition")
        # Conditions in which the sawtooth has no steady motion do not count when drives are compared with it.
        no_worse = np.all(
            ~(merits[:n] < np.nan_to_num(merits[saw], nan=-np.inf) - NO_WORSE * self.scale), axis=1
        ) & ~np.isnan(merits[:n]).any(axis=1)
        scores[:n][~no_worse] = -np.inf
        k = int(np.argmax(scores[:n])) if no_worse.any() else saw
        if k != saw and scores[k] < scores[saw]:
            k = saw
        spent += best.evaluations + found.steps.size
        return self.described(shapes, drives, played, at_piezo, found, k, saw, spent)

    def at_updates(self, shape: Polygons) -> list[Polygons]:
        """Return copies of a drive with the next shorter and the next longer period that is a whole number of
        the converter's updates, scaled to keep the slope limit. Without a converter, return the unchanged
        drive alone."""
        output = self.allowed.output
        if not output.updates:
            return [shape]
        updates = shape.period[0] * output.update_rate
        counts = {
            int(np.clip(n, np.ceil(1e-9 + 1.0), output.points)) for n in (np.floor(updates), np.ceil(updates))
        }
        return [
            shape._replace(period=np.array([n / output.update_rate])).within(self.allowed)
            for n in sorted(counts)
        ]

    def played(self, drives: list[Waveform]) -> list[Waveform]:
        """Return the drives as the converter outputs them: sampled at its updates and rounded to its steps.
        They are unchanged without a converter."""
        output = self.allowed.output
        if not output.updates:
            return drives
        return [output.played(drive, self.allowed.low, self.allowed.high) for drive in drives]

    def at_piezo(self, drives: list[Waveform]) -> list[Waveform]:
        """Return the drives as they reach the piezo, behind the amplifier; unchanged without an amplifier."""
        output = self.allowed.output
        # Without an amplifier's data, only its slope limit counts, which the drives already keep.
        if output.amplifier is None:
            return drives
        return [output.at_piezo(drive) for drive in drives]

    def described(
        self,
        shapes: list[Polygons],
        drives: list[Waveform],
        played: list[Waveform],
        at_piezo: list[Waveform],
        found: PeriodicMotions,
        k: int,
        saw: int,
        spent: int,
    ) -> OptimisedWaveform:
        values = [self.goal.of(shapes[i], found.of(i))[0] for i in (k, saw)]
        speeds = [found.steps[i] / shapes[i].period[0] for i in (k, saw)]
        self.refuse_slow(speeds[0])
        judge, which = Judge(self.quantile, None, self.scale), np.arange(found.steps.shape[1])
        worst = [float(self.goal.sign * judge.score(self.goal.sign * v[None], which)[0]) for v in values]
        return OptimisedWaveform(
            waveform=drives[k],  # type: ignore[arg-type]
            value=worst[0],
            played=played[k] if self.allowed.output.updates else None,  # type: ignore[arg-type]
            at_piezo=at_piezo[k],
            sawtooth_at_piezo=at_piezo[saw],
            sawtooth=shapes[saw].sawtooth(0),
            sawtooth_value=worst[1],
            goal=self.goal,
            model=self.model,
            conditions=self.conditions,
            values=values[0],
            sawtooth_values=values[1],
            speeds=speeds[0],
            sawtooth_speeds=speeds[1],
            quantile=self.quantile,
            evaluations=spent,
            fell_back=k == saw,
        )
