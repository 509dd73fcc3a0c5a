"""The sections of the report on what a campaign does on request: see `deeper`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..figures.identification import law_ranking
from ..figures.posterior import posterior_corner
from ..figures.style import svg
from ..identify.candidates import Comparison
from ..identify.walk.bayes import Posterior
from ..identify.walk.position_channel import CHANNEL
from ..report import Column, Number, Picture, Section, Table
from .evaluation import Found
from .stage import unit_of

# The thesis's choice (ch. 3), with its steady friction constant.
THESIS = "LuGre"
# Errors on what was not fitted that differ by less are the same.
SAME = 0.01


def deeper_numbers(found: Found) -> dict[str, Any]:
    """For results.json: what was asked for."""
    more, numbers = found.deeper, {}
    if more.profiles is not None:
        numbers["profiles"] = {
            name: Number(found.friction.values[name], unit_of(found.friction, name), *ends)
            for name, ends in more.profiles.items()
        }
    if more.posterior is not None:
        numbers["posterior"] = {
            **_estimates(more.posterior),
            "converged": more.posterior.converged,
            "message": more.posterior.message,
        }
    if more.choice is not None:
        table = more.choice.table
        numbers["model_choice"] = {
            str(law): {
                key: Number(float(table[key].sel(law=law)), str(table[key].attrs["units"]))
                for key in ("r_squared", "verification_r_squared", "verification_rmse", "aic", "bic")
            }
            for law in table["law"].values
        }
    return numbers


def deeper_sections(found: Found, *, figures: bool) -> list[Section]:
    """Those that were asked for."""
    more, sections = found.deeper, []
    if more.profiles is not None or more.posterior is not None:
        sections.append(_without_linearisation(found, figures))
    if more.choice is not None:
        sections.append(_choice(more.choice, found.friction.recordings[0].n_data, figures))
    return sections


def _estimates(posterior: Posterior) -> dict[str, Number]:
    found = {}
    for name in map(str, posterior.summary["parameter"].values):
        row = posterior.summary.sel(parameter=name)
        ends = float(row["low"]), float(row["high"])
        unit = posterior.samples[name].attrs["units"]
        found[name] = Number(float(row["mean"]), unit, *ends, float(row["sd"]))
    return found


def _without_linearisation(found: Found, figures: bool) -> Section:
    fit, more = found.friction, found.deeper
    columns, said, tables, pictures = [Column("parameter"), Column("linearised")], [], [], []
    of: list[dict[str, Number]] = [
        {n: Number(fit.values[n], unit_of(fit, n), *ends) for n, ends in fit.confidence_intervals().items()}
    ]
    if more.profiles is not None:
        columns.append(Column("profile likelihood"))
        of.append(
            {n: Number(fit.values[n], unit_of(fit, n), *ends) for n, ends in more.profiles.items()},
        )
        said.append("Profile likelihood: each value is held, and all others fitted again.")
    if more.posterior is not None:
        columns.append(Column("posterior"))
        of.append(_estimates(more.posterior))
        prior = "those of the stage have the estimate and covariance of the steps as prior"
        said.append(
            "Posterior: by an ensemble sampler, the prior flat within the bounds of the fit (in the "
            f"logarithm of what is fitted by it); {prior if found.stage else 'the stage is taken as known'}. "
            f"{more.posterior.message[0].upper()}{more.posterior.message[1:]}."
        )
        tables.append(_chain(more.posterior))
        shown = [n for n in fit.values if n not in CHANNEL]
        if figures:
            pictures.append(
                Picture(
                    "campaign-posterior",
                    "Posterior of the friction parameters: each alone, and by pairs (half and nine tenths of "
                    "the samples within the lines); dashed, the estimate of the fit.",
                    svg(
                        posterior_corner(
                            {n: more.posterior.samples[n].values.ravel() for n in shown},
                            {n: unit_of(fit, n) for n in shown},
                            {n: fit.values[n] for n in shown},
                        )
                    ),
                    "Histograms of each friction parameter and contours of each pair of them",
                )
            )
    names = [n for n in fit.values if n not in CHANNEL]
    rows = [(n, *(by.get(n) for by in of)) for n in names]
    first = Table(
        "95 % intervals of the same fit by different means.",
        columns,
        rows,
        notes="The errors of the stage are in the posterior only.",
    )
    return Section(
        "Intervals without linearisation", paragraphs=said, tables=(first, *tables), figures=pictures
    )


def _chain(posterior: Posterior) -> Table:
    columns = (
        Column("parameter"),
        Column("mean [95 %, highest density]"),
        Column("R-hat", "", 4),
        Column("effective samples", "", 3),
        Column("autocorrelation time, steps", "", 3),
    )
    rows = []
    for name, number in _estimates(posterior).items():
        row = posterior.summary.sel(parameter=name)
        rows.append((name, number, *(float(row[k]) for k in ("r_hat", "ess", "autocorrelation_time"))))
    return Table("The posterior of all that was sampled.", columns, rows)


def conclusion(choice: Comparison) -> str:
    """Whether the thesis's choice holds, in numbers."""
    table = choice.table
    rmse, bic = table["verification_rmse"], table["bic"] - table["bic"].min()
    best, least = choice.best, float(rmse.min())
    own = float(rmse.sel(law=THESIS)) / least - 1.0
    simplest = str(bic.idxmin("law").item())
    seen = (
        f"By the error on walks that were not fitted {best} is best, {1e9 * least:.4g} nm; by BIC "
        f"{simplest}. "
        f"{THESIS}, the thesis's choice, is {100 * own:.2g} % above the least error and "
        f"{float(bic.sel(law=THESIS)):.3g} above the least BIC"
    )
    rivals = [
        str(law)
        for law in table["law"].values
        if law != THESIS and float(rmse.sel(law=law)) < least * (1 + SAME) and float(bic.sel(law=law)) < 10.0
    ]
    if own >= SAME or float(bic.sel(law=THESIS)) >= 10.0:
        return f"{seen}: these recordings do not confirm it."
    if rivals:
        return f"{seen}: confirmed, though these recordings cannot tell it from {', '.join(rivals)}."
    return f"{seen}: confirmed."


def _choice(choice: Comparison, n_data: int, figures: bool) -> Section:
    table = choice.table
    order = np.argsort(table["verification_rmse"].values)
    laws = [str(law) for law in table["law"].values]
    lowest = {key: float(table[key].min()) for key in ("aic", "bic")}
    rows = []
    for i in order:
        fit = choice.fits[laws[i]]
        rows.append(
            (
                laws[i],
                int(table["n_parameters"][i]),
                *(float(table[k][i]) for k in ("r_squared", "verification_r_squared", "verification_rmse")),
                *(float(table[k][i]) - lowest[k] for k in ("aic", "bic")),
                fit.doubt,
            )
        )
    columns = (
        Column("model"),
        Column("fitted", ""),
        Column("r², fitted", "", 6),
        Column("r², not fitted", "", 6),
        Column("rms error, not fitted", "m", 4),
        Column("AIC above least", "", 4),
        Column("BIC above least", "", 4),
        Column("remark"),
    )
    pictures = []
    if figures:
        labels = [f"{law} ({int(n)})" for law, n in zip(laws, table["n_parameters"].values, strict=True)]
        pictures.append(
            Picture(
                "campaign-models",
                "What each model leaves unexplained of the walk it was fitted to, and of the others.",
                svg(
                    law_ranking(
                        labels,
                        table["r_squared"].values,
                        table["verification_r_squared"].values,
                        None if not math.isfinite(lowest["bic"]) else table["bic"].values,
                    )
                ),
                "One minus r squared of each model, on a logarithmic scale, and its BIC",
            )
        )
    return Section(
        "Choice of model",
        paragraphs=(
            f"All models fitted alike to the same walk ({n_data} samples), with delay and offset free, and "
            "judged on the walks that none has seen.",
            conclusion(choice),
        ),
        tables=(Table("Models by their error on walks that were not fitted.", columns, rows),),
        figures=pictures,
    )
