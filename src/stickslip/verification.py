"""A fitted model against recordings that the fit has not seen [kang2007, 5.4 and appendix 6]."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from .identify.channels import channel, names_of, recordings_of, same_number
from .identify.result import Fit, Goodness, goodness
from .recording import RecordingError, make_recording


@dataclass(frozen=True, eq=False)
class Verification:
    """How well a model predicts recordings.

    Attributes:
        observed: name of the channel.
        unit: its unit.
        recordings: the goodness of each.
        predictions: for each a recording with measured, predicted and residual (predicted minus measured).
    """

    observed: str
    unit: str
    recordings: tuple[Goodness, ...]
    predictions: tuple[xr.Dataset, ...]

    @property
    def r_squared(self) -> float:
        """(SST - SSE)/SST over all recordings, each about its own mean [kang2007, appendix 6]."""
        sst = sum(g.sst for g in self.recordings)
        return (sst - sum(g.sse for g in self.recordings)) / sst if sst > 0 else math.nan

    @property
    def rmse(self) -> float:
        """Root mean square of all residuals, in the unit of the channel."""
        return math.sqrt(sum(g.sse for g in self.recordings) / sum(g.n_data for g in self.recordings))

    @property
    def table(self) -> xr.Dataset:
        """r_squared, rmse, largest_error and n_data over "recording"."""
        errors = [float(np.max(np.abs(p["residual"].values))) for p in self.predictions]
        columns = {
            "r_squared": ([g.r_squared for g in self.recordings], ""),
            "rmse": ([g.rmse for g in self.recordings], self.unit),
            "largest_error": (errors, self.unit),
            "n_data": ([g.n_data for g in self.recordings], ""),
        }
        return xr.Dataset(
            {name: ("recording", values, {"units": unit}) for name, (values, unit) in columns.items()},
            coords={"recording": [g.name for g in self.recordings]},
        )

    def report(self) -> str:
        """A text table, one line for each recording and one for all."""
        width = max(len("recording"), *(len(g.name) for g in self.recordings))
        lines = [
            f"prediction of {self.observed} [{self.unit}]",
            f"{'recording':{width}}  {'r^2':9}  {'rmse':10}  data",
        ]
        rows = [(g.name, g.r_squared, g.rmse, g.n_data) for g in self.recordings]
        if len(rows) > 1:
            rows.append(("all", self.r_squared, self.rmse, sum(g.n_data for g in self.recordings)))
        return "\n".join([*lines, *(f"{n:{width}}  {r:9.6f}  {e:<10.4g}  {k}" for n, r, e, k in rows)])

    def to_dict(self) -> dict[str, Any]:
        """Every number with its unit, ready for JSON; None where r^2 does not exist."""
        return {
            "observed": self.observed,
            "unit": self.unit,
            "r_squared": _finite(self.r_squared),
            "rmse": self.rmse,
            "recordings": {
                g.name: {"r_squared": _finite(g.r_squared), "rmse": g.rmse, "n_data": g.n_data}
                for g in self.recordings
            },
        }


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


def verify(
    fit: Fit, recordings: xr.Dataset | Sequence[xr.Dataset], *, drive: Any | Sequence[Any] | None = None
) -> Verification:
    """Predict recordings with a fitted model, nothing fitted again.

    Args:
        fit: of an identification that builds a model.
        recordings: with the channels that the identification needed.
        drive: waveform of each recording (one: of all) where the fit took waveforms.

    Raises:
        RecordingError: a channel is missing, too short or not finite; numbers do not match.
        ValueError: the fit has no model to predict with.
    """
    if fit.predict is None:
        raise ValueError("this fit has no model that predicts recordings")
    found = recordings_of(recordings)
    names = names_of(found)
    drives = [drive] * len(found) if hasattr(drive, "drive") else same_number(drive, found, "drives")
    goods, predictions = [], []
    for recording, waveform, name in zip(found, drives, names, strict=True):
        measured = channel(recording, fit.observed, name)
        unit = str(recording[fit.observed].attrs.get("units", ""))
        predicted = fit.predict(recording) if waveform is None else fit.predict(recording, waveform)
        if not np.all(np.isfinite(predicted)):
            raise RecordingError(f"the model cannot predict {fit.observed} [{unit}] of {name}")
        variables = {"measured": measured, "predicted": predicted, "residual": predicted - measured}
        goods.append(goodness(predicted - measured, measured, name, unit))
        predictions.append(
            make_recording(recording["time"].values, {k: (v, unit) for k, v in variables.items()}, title=name)
        )
    return Verification(fit.observed, goods[0].unit, tuple(goods), tuple(predictions))
