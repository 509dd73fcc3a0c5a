"""Sizes of the walks that need no model: a section of the report, and its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import xarray as xr

from ..analysis.alignment import Aligned
from ..identify.events.sawtooth import sawtooth_features
from ..recording import RecordingError
from ..report import Column, Number, Section, Table

_DIRECTION = {1.0: "forward", -1.0: "back"}
_STEPS = ("up", "down", "scatter", "drift")
_WHOLE = ("delay", "asymmetry", "vibration_amplitude", "vibration_frequency", "vibration_decay")
_UNITS = dict(zip(_WHOLE, ("s", "", "m", "Hz", "1/s"), strict=True))


def features_of(walks: Sequence[Aligned]) -> dict[str, xr.Dataset | str]:
    """The features of each walk; where there are none to be found, why."""
    found: dict[str, xr.Dataset | str] = {}
    for one in walks:
        try:
            found[one.name] = sawtooth_features(one.recording)
        except RecordingError as error:
            found[one.name] = str(error)
    return found


def feature_numbers(features: dict[str, xr.Dataset | str]) -> dict[str, Any]:
    """For results.json: by walk, then by direction."""
    numbers: dict[str, Any] = {}
    for name, of in features.items():
        if isinstance(of, str):
            numbers[name] = {"none": of}
            continue
        numbers[name] = {key: Number(float(of.attrs[key]), unit) for key, unit in _UNITS.items()}
        for i, direction in enumerate(of["direction"].values):
            row = {key: Number(float(of[key][i]), "m") for key in _STEPS}
            row["step_of_peaks"] = Number(
                float(of["net_step"][i]), "m", standard_error=float(of["net_step_error"][i])
            )
            row["slips"] = Number(float(of["n_slips"][i]), "")
            numbers[name][_DIRECTION[float(direction)]] = row
    return numbers


def features_section(features: dict[str, xr.Dataset | str]) -> Section:
    """Tables of the steps, and of what follows the slips."""
    steps, after, missing = [], [], []
    for name, of in features.items():
        if isinstance(of, str):
            missing.append(of)
            continue
        for i, direction in enumerate(of["direction"].values):
            error = 1.96 * float(of["net_step_error"][i])
            net = float(of["net_step"][i])
            steps.append(
                (
                    name,
                    _DIRECTION[float(direction)],
                    int(of["n_slips"][i]),
                    *(_known(float(of[key][i])) for key in ("up", "down")),
                    Number(net, "m", net - error, net + error) if math.isfinite(error) else _known(net),
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
                "the slope of a line through them, the scatter that of single steps, the drift their change "
                "from one to the next. (The net step under Verification is that of the mean position.)",
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
                notes="Left out: a vibration of less than four standard errors, or too fast for the samples.",
            )
        )
    return Section(
        "Steps and vibration, without a model",
        paragraphs=("Found in the positions alone; the drive only tells where to look for the slips.",),
        points=missing,
        tables=tables,
    )


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
