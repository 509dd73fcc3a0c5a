"""View of a comparison of models: their ranking, and whether the usual choice is confirmed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...identify.candidates import Comparison
from ...quantities.units import near_one, with_prefix
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.identification import law_ranking
from ..figures.style import svg
from ..fits import fit_numbers
from ..viewing import document_of

# Name of the usual friction model of stick-slip actuators [kang2007, ch. 3]; its steady friction is constant.
USUAL = "LuGre"
# Relative difference of rms errors on recordings that were not fitted, below which two models count as
# equally good.
SAME = 0.01


@document_of.register
def comparison_document(found: Comparison) -> Document:
    """Return a document with the ranking of friction models by their errors on recordings not fitted."""
    best = found.verifications[found.best]
    return Document(
        title="Comparison of models",
        summary=f"{found.best} predicts recordings that no fit has seen best: r² {near_one(best.r_squared)}, "
        f"rms error {with_prefix(best.rmse, best.unit)}.",
        sections=(choice_section(found),),
        highlights=(("r² of the best on unseen recordings", Number(best.r_squared, "")),),
        numbers={"best": found.best, "models": choice_numbers(found)},
    )


def choice_numbers(found: Comparison) -> dict[str, Any]:
    """Return the numbers of each model's fit, and its errors on recordings not fitted, for results.json.

    The keys are the labels of the models; the errors are "verification_r_squared" and "verification_rmse".
    """
    return {
        label: {
            **fit_numbers(fit, seen.unit),
            "verification_r_squared": Number(seen.r_squared, ""),
            "verification_rmse": Number(seen.rmse, seen.unit),
        }
        for (label, fit), seen in zip(found.fits.items(), found.verifications.values(), strict=True)
    }


def _plain(number: float) -> str:
    return f"{number:,.0f}" if abs(number) >= 100.0 else f"{number:.3g}"


def conclusion(choice: Comparison) -> str:
    """Return a text with numbers on whether the recordings confirm the usual choice, the LuGre model.

    They do if its rms error on recordings that were not fitted exceeds the least error by less than the
    fraction `SAME`, and its BIC exceeds the least by less than 10. Models that are as good are named. The
    LuGre model must be among the compared ones.
    """
    table = choice.table
    rmse, bic = table["verification_rmse"], table["bic"] - table["bic"].min()
    best, least = choice.best, float(rmse.min())
    own = float(rmse.sel(law=USUAL)) / least - 1.0
    simplest = str(bic.idxmin("law").item())
    seen = (
        f"By the error on recordings that were not fitted {best} is best, "
        f"{with_prefix(least, rmse.attrs['units'])}; by BIC {simplest}. "
        f"{USUAL}, the usual choice, is {_plain(100 * own)} % above the least error and "
        f"{_plain(float(bic.sel(law=USUAL)))} above the least BIC"
    )
    rivals = [
        str(law)
        for law in table["law"].values
        if law != USUAL and float(rmse.sel(law=law)) < least * (1 + SAME) and float(bic.sel(law=law)) < 10.0
    ]
    if own >= SAME or float(bic.sel(law=USUAL)) >= 10.0:
        return f"{seen}: these recordings do not confirm it."
    if rivals:
        return f"{seen}: confirmed, though these recordings cannot tell it from {', '.join(rivals)}."
    return f"{seen}: confirmed."


def choice_section(found: Comparison, marks: Mapping[str, float] | None = None) -> Section:
    """Return a section with the ranking of the models, a table and a figure.

    If the usual model is among them, the section also has the text of `conclusion` on whether the ranking
    confirms it.

    Args:
        found: the compared models.
        marks: r² that other authors reached on such data, by their description in the table.
    """
    table, marks = found.table, marks or {}
    n_data = next(iter(found.fits.values())).n_data
    return Section(
        "Choice of model",
        paragraphs=(
            f"All models fitted alike to the same {n_data} samples, and judged on recordings that none has "
            "seen.",
            *((conclusion(found),) if USUAL in found.fits else ()),
        ),
        tables=(_ranking_table(found, marks),),
        figures=(
            Picture(
                "models",
                "What each model leaves unexplained where it was fitted, and where it predicts.",
                svg(
                    law_ranking(
                        [f"{law} ({fit.n_estimated:.3g})" for law, fit in found.fits.items()],
                        table["r_squared"].values,
                        table["verification_r_squared"].values,
                        table["bic"].values if np.all(np.isfinite(table["bic"])) else None,
                        marks,
                    )
                ),
                "One minus r squared of each model, on a logarithmic scale, and its BIC",
            ),
        ),
    )


def _ranking_table(found: Comparison, marks: Mapping[str, float]) -> Table:
    """Return a table of the models, sorted by their rms error on recordings that were not fitted.

    A row has the number of fitted parameters, r² on fitted and on other recordings, the rms error, AIC and
    BIC above the least ones, and a remark.
    """
    table = found.table
    lowest = {key: float(table[key].min()) for key in ("aic", "bic")}
    labels, keys = list(found.fits), ("r_squared", "verification_r_squared", "verification_rmse")
    rows = [
        (
            labels[i],
            found.fits[labels[i]].n_estimated,
            *(float(table[key][i]) for key in keys),
            *(float(table[key][i]) - least for key, least in lowest.items()),
            found.fits[labels[i]].doubt,
        )
        for i in np.argsort(table["verification_rmse"].values)
    ]
    columns = (
        Column("model"),
        Column("fitted", ""),
        Column("r², fitted", "", 6),
        Column("r², not fitted", "", 6),
        Column("rms error, not fitted", str(table["verification_rmse"].attrs["units"]), 4),
        Column("AIC above least", "", 4),
        Column("BIC above least", "", 4),
        Column("remark"),
    )
    notes = " ".join(f"Known mark: {what}, {value:g}." for what, value in marks.items())
    return Table("Models by their error on recordings that were not fitted.", columns, rows, notes=notes)
