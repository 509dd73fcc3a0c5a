"""Result of an optimised drive signal, and simulation of the motion within a period under some drives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate.shown import preformatted
from ..physics.actuator import Actuator
from ..quantities.units import labelled_for, unit_for, with_prefix
from ..simulation import simulate
from ..waveform.knots import PeriodicKnots
from ..waveform.periodic import Sawtooth
from ..waveform.sampled import Sampled
from .scenarios import NOMINAL, ScenarioTable

Array = NDArray[np.float64]
# SETTLED: number of simulated periods after which `motion_by` treats the motion as periodic. POINTS: number
# of points of the period that `motion_by` returns.
SETTLED, POINTS = 200, 401
# Largest number of conditions that a report lists: the unchanged model and the worst ones.
MOST_LINES = 12


@dataclass(frozen=True, eq=False, repr=False)
class OptimisedWaveform:
    """Result of `optimise_waveform`. Values belong to the drive as it reaches the piezo.

    Attributes:
        waveform: the best drive found.
        value: goal in the worst condition (or at the chosen quantile), in SI.
        played: the drive as the converter outputs it; None for an output without updates.
        at_piezo: the voltage at the piezo, behind converter and amplifier, if given; `sawtooth_at_piezo` is
            the same for the sawtooth.
        sawtooth: best sawtooth within the same limits and conditions, with the same converter and amplifier;
            `sawtooth_value` is the goal that it reaches.
        goal, model, conditions, quantile: what the search was for: goal, actuator, conditions, and the
            quantile over them (0: the worst).
        values, speeds: goal [SI] and speed [m/s, or rad/s for a rotary actuator] of the drive in every
            condition; `sawtooth_values`, `sawtooth_speeds` are the same for the sawtooth.
        evaluations: number of computed periodic motions.
        fell_back: True if the drive is the sawtooth itself, because no drive was found that is at least as
            good in every condition.
        interrupted: True if Ctrl-C stopped the search; the result is then the best one found so far.
    """

    waveform: PeriodicKnots
    value: float
    played: Sampled | None
    at_piezo: Any
    sawtooth_at_piezo: Any
    sawtooth: Sawtooth
    sawtooth_value: float
    goal: Any
    model: Actuator
    conditions: ScenarioTable
    values: Array
    sawtooth_values: Array
    speeds: Array
    sawtooth_speeds: Array
    quantile: float
    evaluations: int
    fell_back: bool
    interrupted: bool = False

    @property
    def frequency(self) -> float:
        """Return the frequency of the drive, Hz."""
        return 1.0 / self.waveform.period

    @property
    def unit(self) -> str:
        """Return the SI unit of the goal for this model (rad instead of m for a rotary actuator)."""
        return unit_for(self.model, self.goal.unit)

    @property
    def comparison(self) -> xr.Dataset:
        """Return the goal in each condition as a Dataset over "scenario" (names of the conditions).

        Variables: `value` with the drive and `sawtooth` with the best sawtooth, in the unit of the goal; and
        each quantity that the conditions change, by its name, SI.
        """
        of_goal = {"units": self.unit, "long_name": self.goal.label}
        data: dict[str, Any] = {
            name: ("scenario", column) for name, column in self.conditions.columns.items()
        }
        data["value"] = ("scenario", self.values, of_goal)
        data["sawtooth"] = ("scenario", self.sawtooth_values, of_goal)
        return xr.Dataset(data, coords={"scenario": list(self.conditions.names)})

    @property
    def table(self) -> Any:
        """Return `comparison` as a pandas DataFrame with a row per condition."""
        return self.comparison.to_dataframe()

    def motion(self) -> xr.Dataset:
        """Return the motion under the drive and the sawtooth, for the unchanged model; see `motion_by`."""
        model = self.model.replace(min_voltage=-math.inf, max_voltage=math.inf)
        return motion_by(model, {"optimised": self.at_piezo, "sawtooth": self.sawtooth_at_piezo})

    def report(self) -> str:
        """Return the result as text, with lines for the unchanged model and for the worst conditions."""
        unit, count = self.unit, len(self.conditions.names)
        how = "in the model as it is"
        if count > 1:
            how = f"in the worst of {count} conditions"
            if self.quantile:
                how = f"at the quantile {self.quantile:g} of {count} conditions"
        said = [
            f"{self.goal.label}: {with_prefix(self.value, unit, 4)} {how}; best sawtooth: "
            f"{with_prefix(self.sawtooth_value, unit, 4)}",
            f"{len(self.waveform.times)} knots at {self.frequency:.4g} Hz; sawtooth at "
            f"{self.sawtooth.frequency:.4g} Hz, rise over {self.sawtooth.rise_fraction:.3g} of the period",
            f"{self.evaluations} periodic motions solved for",
        ]
        if self.played is not None:
            said.append(
                f"as played: {self.played.times.size} points at "
                f"{with_prefix(self.played.period / self.played.times.size, 's')}"  # type: ignore[operator]
            )
        if self.interrupted:
            said.append("stopped before the end of the search: the best until then")
        if self.fell_back:
            said.append("no drive was found that is worse than the sawtooth nowhere: this IS the sawtooth")
        order = np.argsort(self.goal.sign * self.values)
        nominal = self.conditions.names.index(NOMINAL)
        shown = [nominal, *(i for i in order.tolist() if i != nominal)][:MOST_LINES]
        width = max(len(self.conditions.names[i]) for i in shown)
        for i in shown:
            pair = (with_prefix(float(v[i]), unit, 4) for v in (self.values, self.sawtooth_values))
            said.append(f"  {self.conditions.names[i]:{width}}  " + "   sawtooth ".join(pair))
        if count > len(shown):
            said.append(f"  ... {count - len(shown)} better ones")
        return "\n".join(said)

    def __repr__(self) -> str:
        return self.report()

    def _repr_html_(self) -> str:
        return preformatted(self)


def motion_by(model: Actuator, drives: Mapping[str, Any]) -> xr.Dataset:
    """Simulate some drives; return the motion within one period as a Dataset over "drive" and "phase".

    Variables: `drive_voltage`, V; `end_effector_position` from the start of the period, m, or rad for a
    rotary actuator; and `period`, s, of each drive. "phase" is the time as a share of the period. The period
    follows `SETTLED` simulated ones.

    Args:
        model: the actuator.
        drives: periodic waveforms by name, V.

    Raises:
        QuantityError, SimulationError: as `simulate`.
    """
    phase, rows = np.linspace(0.0, 1.0, POINTS), []
    for drive in drives.values():
        period = float(drive.period)
        times = (SETTLED + phase) * period
        moved = simulate(model, drive, times=times)["end_effector_position"].values
        rows.append((drive.value(times * (1.0 - 1e-12)), moved - moved[0], period))
    volts, moved, periods = (np.array(column) for column in zip(*rows, strict=True))
    both = ("drive", "phase")
    made = xr.Dataset(
        {
            "drive_voltage": (both, volts, {"units": "V", "long_name": "drive voltage"}),
            "end_effector_position": (both, moved, {"units": "m", "long_name": "end-effector position"}),
            "period": ("drive", periods, {"units": "s", "long_name": "period"}),
        },
        coords={"drive": list(drives), "phase": ("phase", phase, {"long_name": "share of the period"})},
    )
    return labelled_for(model, made)
