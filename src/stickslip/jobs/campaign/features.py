"""Features of walks, such as step sizes, found without a model: report section and numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ...estimate.quantiles import reach
from ...identify.events.sawtooth import sawtooth_features
from ...recording import RecordingError
from ...report import Column, Number, Section, Table
from ..analysis.alignment import Aligned

if TYPE_CHECKING:
    import xarray as xr

_DIRECTION = {1.0: "forward", -1.0: "back"}
_STEPS = ("up", "down", "scatter", "drift")
_WHOLE = ("delay", "asymmetry", "vibration_amplitude", "vibration_frequency", "vibration_decay")
_UNITS = dict(zip(_WHOLE, ("s", "", "m", "Hz", "1/s"), strict=True))


def features_of(walks: Sequence[Aligned]) -> dict[str, xr.Dataset | str]:
    """Return the features of each walk by name, see `sawtooth_features`; or the reason of their lack, a
    text."""
    found: dict[str, xr.Dataset | str] = {}
    for one in walks:
        try:
            found[one.name] = sawtooth_features(one.recording)
        except RecordingError as error:
            found[one.name] = str(error)
    return found


def feature_numbers(features: Mapping[str, xr.Dataset | str]) -> dict[str, Any]:
    """Return the result of `features_of` for results.json, by name of the walk.

    A walk has numbers of the vibration after slips and, under "forward" and "back", numbers of its steps. A
    walk without features has only "none", the reason. Numbers are in m; `in_turns` makes them rad.
    """
    numbers: dict[str, Any] = {}
    for name, of in features.items():
        if isinstance(of, str):
            numbers[name] = {"none": of}
            continue
        numbers[name] = {key: Number(float(of.attrs[key]), unit) for key, unit in _UNITS.items()}
        for i, direction in enumerate(of["direction"].values):
            row = {key: Number(float(of[key][i]), "m") for key in _STEPS}
            row["step_of_peaks"] = _step_of_peaks(of.isel(walk=i))
            row["slips"] = Number(float(of["n_slips"][i]), "")
            numbers[name][_DIRECTION[float(direction)]] = row
    return numbers


def features_section(features: Mapping[str, xr.Dataset | str]) -> Section:
    """Return the report section with tables of the steps, and of the vibration after slips.

    `features` is the result of `features_of`. Lengths are in m; `in_turns` makes them rad.
    """
    steps, after, missing = [], [], []
    for name, of in features.items():
        if isinstance(of, str):
            missing.append(of)
            continue
        for i, direction in enumerate(of["direction"].values):
            steps.append(
                (
                    name,
                    _DIRECTION[float(direction)],
                    int(of["n_slips"][i]),
                    *(_known(float(of[key][i])) for key in ("up", "down")),
                    _step_of_peaks(of.isel(walk=i)) if math.isfinite(of["net_step"][i]) else None,
                    *(_known(float(of[key][i])) for key in ("scatter", "drift")),
                )
            )
        values = {key: float(of.attrs[key]) for key in _WHOLE}
        share = 100.0 * values.pop("asymmetry")
        after.append((name, *(_known(v) for v in values.values()), _known(share)))
    tables = []
    if steps:
        columns = (
            Column("recording"),
            Column("walk"),
            Column("slips", ""),
            Column("up-step a", "m"),
            Column("down-step b", "m"),
            Column("step of the peaks [95 %]", "m"),
            Column("scatter", "m", 2),
            Column("drift per slip", "m", 2),
        )
        tables.append(
            Table(
                "Steps of the walks.",
                columns,
                steps,
                notes="Between slips a walk rises by a, in a slip it falls by b. The step of the peaks is "
                "their mean step; its interval allows for noise of the positions and for scatter of the "
                "steps, which adds up along a walk. The scatter is that of single steps, the drift their "
                "change from one to the next. (The net step under Verification is that of the mean "
                "position.)",
            )
        )
        columns = (
            Column("recording"),
            Column("slip behind the drive", "s", 3),
            Column("vibration", "m", 3),
            Column("its frequency", "Hz", 3),
            Column("its decay", "1/s", 3),
            Column("step back over forward, less one", "%", 2),
        )
        tables.append(
            Table(
                "What follows a slip, the mean over all slips of a recording.",
                columns,
                after,
                notes="The vibration is that of the first part of the period after a slip that shows a ring. "
                "Left out: one of less than four standard errors or three cycles, too fast for the samples, "
                "or that does not explain the motion; and the decay of one that lasts until the next slip, "
                "or where it is uncertain.",
            )
        )
    return Section(
        "Steps and vibration, without a model",
        paragraphs=("Found in the positions alone; the drive only tells where to look for the slips.",),
        points=missing,
        tables=tables,
    )


def _step_of_peaks(walk: xr.Dataset) -> Number:
    """Return the mean step per slip of one walk, m (`in_turns` makes it rad).

    The result has a standard error and a 95 % interval if the walk has more than one step. `walk` is one
    entry over "walk" of `sawtooth_features`.
    """
    net, error = float(walk["net_step"]), float(walk["net_step_error"])
    if not math.isfinite(error):
        return Number(net, "m", standard_error=error)
    reached = error * reach(0.95, float(walk["net_step_freedom"]))
    return Number(net, "m", net - reached, net + reached, standard_error=error)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
