"""Comparison of candidate models: all are fitted to the same recordings and judged on recordings that no fit
used."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ..estimate.goodness import Goodness, goodness
from ..estimate.result import Fit
from ..estimate.shown import preformatted
from ..quantities.progress import Progress
from .free import Bounds
from .recorded.channels import channel, names_of, recordings_of


class Candidate(NamedTuple):
    """A model to compare, and the settings of its fit.

    Attributes:
        label: name of the model in the comparison.
        model: friction law (or another model) with initial values; None: a model that has no law.
        free: names of the parameters to fit.
        bounds: bounds (lower, upper) of parameters by name, in SI or as strings.
        starts: number of initial guesses; above 1 for a law whose sum of squares has several local minima.
        tied: expressions of tied parameters by name.
        priors: value and standard deviation of parameters by name.
    """

    label: str
    model: Any
    free: tuple[str, ...]
    bounds: Bounds
    starts: int = 1
    # All candidates share these empty default mappings; they are never changed.
    tied: Mapping[str, str] = {}
    priors: Mapping[str, tuple[float | str, float | str]] = {}


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of models that were fitted to the same recordings.

    Fields: `fits`, the fit of each model by label; `verifications`, the goodness of its predictions of all
    recordings that no fit used, by label.
    """

    fits: Mapping[str, Fit]
    verifications: Mapping[str, Goodness]

    @property
    def best(self) -> str:
        """Return the label of the model with the highest r^2 on the verification recordings."""
        return max(self.verifications, key=lambda label: self.verifications[label].r_squared)

    @property
    def table(self) -> xr.Dataset:
        """Return a dataset over "law" (the labels).

        Its variables are r_squared and rmse on the fitted recordings, verification_r_squared and
        verification_rmse on the others (rmse in the unit of the channel), aic, bic, n_parameters and
        converged.
        """
        fits, seen = list(self.fits.values()), list(self.verifications.values())
        columns = {
            "r_squared": ([f.r_squared for f in fits], ""),
            "verification_r_squared": ([g.r_squared for g in seen], ""),
            "rmse": ([f.rmse for f in fits], seen[0].unit),
            "verification_rmse": ([g.rmse for g in seen], seen[0].unit),
            "aic": ([f.aic for f in fits], ""),
            "bic": ([f.bic for f in fits], ""),
            "n_parameters": ([len(f.parameters) for f in fits], ""),
            "converged": ([f.converged for f in fits], ""),
        }
        return xr.Dataset(
            {name: ("law", values, {"units": unit}) for name, (values, unit) in columns.items()},
            coords={"law": list(self.fits)},
        )

    _repr_html_ = preformatted

    def report(self) -> str:
        """Return a text table with one line for each model: r^2 of the fit, r^2 and rmse of the verification,
        AIC and BIC as differences from their lowest values, number of parameters, and doubts."""
        lowest_aic = min(f.aic for f in self.fits.values())
        lowest_bic = min(f.bic for f in self.fits.values())
        width = max(map(len, self.fits))
        lines = [
            f"{'law':{width}}  {'r^2 fit':9}  {'r^2 unseen':10}  {'rmse unseen':11}  "
            f"{'dAIC':>9}  {'dBIC':>9}  parameters"
        ]
        for label, fit in self.fits.items():
            g = self.verifications[label]
            state = f"  {fit.doubt}" if fit.doubt else ""
            lines.append(
                f"{label:{width}}  {fit.r_squared:9.6f}  {g.r_squared:10.6f}  {g.rmse:9.4g} {g.unit}  "
                f"{fit.aic - lowest_aic:9.1f}  {fit.bic - lowest_bic:9.1f}  {len(fit.parameters)}{state}"
            )
        return "\n".join(lines)


def compared(
    laws: Sequence[Candidate],
    fit: Callable[[Candidate], Fit],
    unseen: xr.Dataset | Sequence[xr.Dataset],
    drives: Sequence[Any] | None,
    observed: tuple[str, str],
    progress: Progress,
) -> Comparison:
    """Fit each candidate, and judge each fit by its predictions of recordings that no fit has used.

    Args:
        laws: the candidates.
        fit: function from a candidate to its fit, which must be able to predict recordings.
        unseen: recordings for verification, predicted with the fitted values.
        drives: waveform of each of these recordings; None: `predict` takes only the recording.
        observed: name of the predicted channel, and its unit.
        progress: called before each candidate with a text and the fraction that is done.
    """
    recordings = recordings_of(unseen)
    given = [()] * len(recordings) if drives is None else [(drive,) for drive in drives]
    measured = [channel(r, observed[0], n) for r, n in zip(recordings, names_of(recordings), strict=True)]
    fits, seen = {}, {}
    for i, law in enumerate(laws):
        progress(f"fitting {law.label}", i / len(laws))
        found = fit(law)
        assert found.predict is not None
        residuals = [found.predict(r, *w) - m for r, w, m in zip(recordings, given, measured, strict=True)]
        parts = [goodness(r, m) for r, m in zip(residuals, measured, strict=True)]
        whole = goodness(np.concatenate(residuals), np.concatenate(measured), "verification", observed[1])
        fits[law.label] = found
        seen[law.label] = whole._replace(sst=sum(g.sst for g in parts))
    return Comparison(fits, seen)
