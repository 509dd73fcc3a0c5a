"""A planned experiment: its recordings, and the expected uncertainty of a fit to them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..estimate.parameter import Parameter
from ..estimate.shown import preformatted
from ..identify.walk.experiments import PlannedWalk
from ..physics.actuator import Actuator
from ..quantities.units import to_si, with_prefix
from ..rig import Limits
from ..waveform import Rest
from ..waveform import Sequence as Parts
from ..waveform.signal import Waveform
from .choice import PlanGoal, criterion, together
from .information import BEFORE, Array, Seen, covariance
from .starting import Start

# HALF: number of standard errors in half a 95 % interval. WIDE: half-width, as a share of the value, from
# which a report says that the linearised interval is only an indication.
HALF, WIDE = 1.959964, 0.5


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """Result of `plan_experiment`.

    Attributes:
        recordings: recordings to make, by name, in the order of their information: the first ones are a good
            plan too.
        dataset: over "parameter", "candidate" and "count" (number of recordings made, in their order). All
            half-widths are those of 95 % intervals, as shares of the value, or in the parameter's unit if the
            value is 0. For each parameter: `value` (SI); `half_width` with all recordings;
            `worst_half_width`, the largest one over the draws; `default_half_width` by the default recording
            in equal time; and `narrower`, the latter over `half_width` (1 if `half_width` is infinite).
            `expected` [count, parameter] and `alone` [candidate, parameter] are half-widths with the first
            recordings, and with a single candidate. For each candidate: `voltage` (greatest minus least, V);
            `frequency` (Hz, NaN if the drive has none); `taken`, how often it is recorded; and `gain`, the
            default's standard error of the goal over the candidate's at equal time.
        correlation: expected correlation of the fitted parameters, over "parameter" and "other".
        goal: name of the goal that the plan optimises.
        model: the actuator with which the recordings were simulated.
        limits: limits that the recordings keep.
        left_out: reasons why candidates were excluded, by the names of the candidates.
        undetermined: parameters that all candidates together do not identify; they are not part of the goal.
    """

    recordings: dict[str, PlannedWalk]
    dataset: xr.Dataset
    correlation: xr.DataArray
    goal: str
    model: Actuator
    limits: Limits
    left_out: dict[str, str]
    undetermined: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Return the duration of all recordings together, s, with their repetitions."""
        return math.fsum(walk.duration * walk.repeats for walk in self.recordings.values())

    @property
    def standard_errors(self) -> dict[str, float]:
        """Return the expected standard error of each parameter by name, SI."""
        value, half = self.dataset["value"].values, self.dataset["half_width"].values
        scale = np.where(value == 0.0, 1.0, np.abs(value))
        return dict(
            zip(self.dataset["parameter"].values.tolist(), (half * scale / HALF).tolist(), strict=True)
        )

    @property
    def table(self) -> Any:
        """Return a pandas DataFrame with a row per parameter and the columns "value", "unit", "half_width",
        "worst_half_width", "default_half_width" and "narrower", as in `dataset`."""
        names = ["value", "half_width", "worst_half_width", "default_half_width", "narrower"]
        return self.dataset[names].to_dataframe().reindex(columns=["value", "unit", *names[1:]])

    def drives(self, before: float | str = BEFORE) -> list[Waveform]:
        """Return the drives of all recordings in the order of the file that `save` writes, one per
        repetition, for `identify_friction`.

        A known drive is better than the samples of drive_voltage, which do not resolve the flanks of a fast
        sawtooth.

        Args:
            before: duration of rest before each drive, s, as for `save`.
        """
        rest = to_si(before, "s", "before")
        found: list[Waveform] = []
        for walk in self.recordings.values():
            drive = Parts(Rest(rest), (walk.drive, walk.duration)) if rest else walk.drive
            found += [drive] * walk.repeats
        return found

    _repr_html_ = preformatted

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """Return the plan as text, with a table of the expected uncertainties."""
        return _report(self)

    def save(self, path: str | os.PathLike[str], **options: Any) -> Path:
        """Write the plan as an experiment file and return its path; arguments and errors as for
        `save_plan`."""
        from .plan_file import save_plan

        return save_plan(self, path, **options)


def of_choice(
    begin: Start,
    walks: Mapping[str, PlannedWalk],
    every: Seen,
    taken: Sequence[int],
    default: Seen,
    goal: PlanGoal,
    limits: Limits,
    left_out: dict[str, str],
) -> Plan:
    """Return the plan that results from a choice of candidates.

    Args:
        begin: starting point of the plan: model and parameters of the fit.
        walks: planned recordings of the candidates by name, in the order of `every`.
        every: information of the candidates, arrays [draws, candidates, ...].
        taken: indices of the chosen candidates, in the order of their information.
        default: information of the default recording, arrays [draws, ...].
        goal: goal of the plan.
        limits: limits that the recordings keep.
        left_out: reasons why candidates were excluded, by name.
    """
    names = list(walks)
    steps = [together(every, taken[: n + 1]) for n in range(len(taken))]
    own = np.flatnonzero(begin.space.own).tolist()
    free = [begin.space.parameters[i] for i in own]
    spread = covariance(steps[-1])[0][np.ix_(own, own)]
    deviations = np.sqrt(np.diag(spread))
    listed = [p.name for p in free]
    told = np.where(np.isfinite(deviations), deviations, np.nan)
    correlation = xr.DataArray(
        np.where(np.isfinite(spread), spread, np.nan) / np.outer(told, told),
        dims=("parameter", "other"),
        coords={"parameter": listed, "other": listed},
    )
    wave = np.array([_wave(walk) for walk in walks.values()])
    dataset = xr.Dataset(
        {
            "value": ("parameter", [p.start for p in free]),
            **_half_widths(free, own, every, steps, default),
            "gain": ("candidate", _gain(every, default, goal), {"units": "", "long_name": goal.name}),
            "voltage": ("candidate", wave[:, 0], {"units": "V", "long_name": "voltage"}),
            "frequency": ("candidate", wave[:, 1], {"units": "Hz", "long_name": "frequency"}),
            "taken": ("candidate", [taken.count(i) for i in range(len(names))]),
        },
        coords={
            "parameter": listed,
            "unit": ("parameter", [p.unit for p in free]),
            "candidate": names,
            "count": np.arange(1, len(taken) + 1),
        },
        attrs={"goal": goal.name, "duration": float(steps[-1].duration[0])},
    )
    recordings = {}
    for one in dict.fromkeys(taken):
        walk = walks[names[one]]
        recordings[names[one]] = walk._replace(repeats=walk.repeats * taken.count(one))
    seen = dict(zip(begin.space.names, goal.own, strict=True))
    lost = tuple(name for name in listed if not seen[name])
    return Plan(recordings, dataset, correlation, goal.name, begin.model, limits, left_out, lost)


def _half_widths(
    free: Sequence[Parameter], own: list[int], every: Seen, steps: Sequence[Seen], default: Seen
) -> dict[str, Any]:
    """Return the variables of the plan's dataset with half-widths of 95 % intervals, by name: "half_width",
    "worst_half_width", "default_half_width", "narrower", "expected" and "alone" (see `Plan`).

    Args:
        free: parameters of the actuator.
        own: their indices among the coordinates of the fit.
        every: information of the candidates, arrays [draws, candidates, ...].
        steps: information of the first one, two, ... chosen recordings, arrays [draws, ...] each.
        default: information of the default recording, arrays [draws, ...].
    """
    # Factors by which the standard deviation of a coordinate is multiplied to get the half-width of a
    # parameter as a share of its value, or in the parameter's unit if the value is 0.
    scales = HALF * np.array([p.slope(p.start) / (abs(p.start) or 1.0) for p in free])

    def halves(of: Seen) -> Array:
        spread = np.diagonal(covariance(of), axis1=-2, axis2=-1)
        return np.sqrt(spread[..., own]) * scales

    per = {"units": "", "long_name": "half-width of the 95 % interval"}
    usual = default.times(float(steps[-1].duration[0]) / float(default.duration[0]))
    half, by_usual = halves(steps[-1]), halves(usual)[0]
    return {
        "half_width": ("parameter", half[0], per),
        "worst_half_width": ("parameter", half.max(axis=0), per),
        "default_half_width": ("parameter", by_usual, per),
        "narrower": (
            "parameter",
            np.divide(by_usual, half[0], out=np.ones(len(own)), where=np.isfinite(half[0])),
        ),
        "expected": (("count", "parameter"), np.array([halves(one)[0] for one in steps]), per),
        "alone": (("candidate", "parameter"), halves(every)[0], per),
    }


def _gain(every: Seen, default: Seen, goal: PlanGoal) -> Array:
    """Return the goal's standard error with the default recording over that with each candidate alone,
    [candidates], at the values of the model.

    Both are compared at equal measuring time: an error falls with the square root of the duration. A
    candidate that does not identify the goal has the factor 0. `every` and `default` are as for `of_choice`.
    """
    usual = criterion(default, goal)[0] + 0.5 * math.log(float(default.duration[0]))
    with np.errstate(over="ignore", invalid="ignore"):
        return np.exp(usual - criterion(every, goal)[0] - 0.5 * np.log(every.duration[0]))


def _wave(walk: PlannedWalk) -> tuple[float, float]:
    """Return the difference between greatest and least voltage [V] of a recording's drive, and the frequency
    [Hz] of the drive's first part; NaN if that part has no frequency."""
    drive: Any = walk.drive
    part = drive.parts[0][0] if isinstance(drive, Parts) else drive
    low, high = walk.drive.range()
    return high - low, float(getattr(part, "frequency", math.nan))


def _report(plan: Plan) -> str:
    of = plan.dataset
    count = sum(walk.repeats for walk in plan.recordings.values())
    wanted = "all parameters" if plan.goal == "all" else plan.goal
    these = "this recording" if count == 1 else f"these {count} recordings"
    lines = [
        f"Planned for {wanted}: {these}, {with_prefix(plan.duration, 's', 3)}, will give "
        + _listed(
            [
                f"{name} within {_percent(x)}"
                for name, x in _rows(of, "half_width")
                if name not in plan.undetermined
            ]
        )
        + " (95 %).",
        *([f"Not determined by any candidate: {_listed(plan.undetermined)}."] if plan.undetermined else []),
        "",
    ]
    for i, (name, walk) in enumerate(plan.recordings.items(), start=1):
        often = f", {walk.repeats} times" if walk.repeats > 1 else ""
        lines.append(
            f"  {i}. {name}: {with_prefix(walk.duration, 's', 3)} at "
            f"{with_prefix(walk.sample_rate, 'Hz', 3)}{often}"
        )
    lines += [
        "",
        f"{'parameter':20}{'value':>14}{'half-width':>12}{'worst draw':>12}{'default':>12}{'narrower':>10}",
    ]
    for name in of["parameter"].values.tolist():
        row = of.sel(parameter=name)
        if name in plan.undetermined:
            lines.append(
                f"{name:20}{with_prefix(float(row['value']), str(row['unit'].values)):>14}{'not told':>12}"
            )
            continue
        unit = str(row["unit"].values)
        lines.append(
            f"{name:20}{with_prefix(float(row['value']), unit):>14}{_percent(float(row['half_width'])):>12}"
            f"{_percent(float(row['worst_half_width'])):>12}{_percent(float(row['default_half_width'])):>12}"
            f"{float(row['narrower']):9.3g}x"
        )
    lines.append("")
    lines.append(
        "Default: its recording repeated for equal time. Half-widths are linearised, of 95 % intervals."
    )
    wide = [name for name, x in _rows(of, "half_width") if not x < WIDE and name not in plan.undetermined]
    if wide:
        lines.append(f"{_listed(wide)}: so wide that the linearised figure is only a sign; more is needed.")
    if plan.left_out:
        lines.append(f"{len(plan.left_out)} candidates were left out; plan.left_out says why.")
    return "\n".join(lines)


def _rows(of: xr.Dataset, name: str) -> list[tuple[str, float]]:
    return list(zip(of["parameter"].values.tolist(), of[name].values.tolist(), strict=True))


def _percent(share: float) -> str:
    if not math.isfinite(share):
        return "not told"
    if share < 0.995:
        return f"{100.0 * share:.2g} %"
    return f"{100.0 * share:.0f} %" if share < 100.0 else f"{100.0 * share:.0e} %"


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
