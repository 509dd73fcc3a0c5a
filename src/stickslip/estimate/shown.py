"""Conversion of a fit to a text table, and to numbers with units."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from .systematic import systematic_numbers

if TYPE_CHECKING:
    from .result import Fit


def as_text(fit: Fit, level: float) -> str:
    """Return a text table of values with units and intervals at the confidence `level` (0 to 1).

    The table is followed by goodness of fit, the end of the search, other minima, lack of fit, doubts,
    correlated residuals, systematic errors, undetermined parameters and remarks.
    """
    intervals, errors = fit.confidence_intervals(level), fit.standard_errors
    wider = systematic_numbers(fit, level)
    more = ("with systematic errors",) if wider else ()
    heads = ("parameter", "value", "standard error", f"{100 * level:g} % interval", *more, "unit")
    values: list[tuple[str, ...]] = [heads]
    for p in fit.shown:
        ends = [intervals[p.name], *([wider[p.name]["both"]] if wider else [])]
        value, error = f"{fit.values[p.name]:.6g}", f"{errors[p.name]:.3g}"
        shown = (f"{low:.6g} .. {high:.6g}" for low, high in ends)
        values.append((p.name, value, error, *shown, f"{p.unit or '-'} {p.state}".strip()))
    rows = [("recording", "r^2", "rmse", "unit", "data", "lag-1 correlation of residuals")]
    for g in fit.recordings:
        figures = f"{g.n_data}", f"{g.lag_one_correlation:.3f}"
        rows.append((g.name, f"{g.r_squared:.6f}", f"{g.rmse:.4g}", g.unit or "-", *figures))
    lines = [*_aligned(values), "", *_aligned(rows), ""]
    if len(fit.recordings) > 1:
        lines.append(f"all recordings: r^2 {fit.r_squared:.6f}")
    # Without given noise, it is a variance in the squared unit of the data; rmse says the same.
    chi = f"reduced chi-squared {fit.reduced_chi_squared:.4g}, " if fit.noise_known else ""
    lines.append(f"{chi}AIC {fit.aic:.2f}, BIC {fit.bic:.2f}")
    state = "converged" if fit.converged else "NOT CONVERGED"
    lines.append(f"{state}: {fit.message} ({fit.n_evaluations} evaluations)")
    if fit.starts > 1:
        lines.append(f"{fit.starts_agreeing} of {fit.starts} searches ended at this minimum")
    if fit.minima:
        lines.append(fit.other_minima)
    lines += [*(one.sentence for one in fit.lack if one.seen), *fit.doubts]
    if not fit.correlated and any(
        abs(g.lag_one_correlation) > fit.judgement.correlated for g in fit.recordings
    ):
        lines.append(
            "the residuals are correlated, which these intervals do not allow for: they are too narrow"
        )
    lines += [f"systematic: {one.sentence}" for one in fit.systematics]
    return "\n".join([*lines, *fit.undetermined, *fit.remarks])


def preformatted(result: Any) -> str:
    """Return the `report` of a result as HTML for a notebook (`_repr_html_`)."""
    return f"<pre>{html.escape(result.report())}</pre>"


def as_dict(fit: Fit, level: float) -> dict[str, Any]:
    """Return the fit as a dictionary for JSON, with None in place of NaN and infinity.

    The keys "parameters" and "recordings" contain a dictionary for each name: value, unit, standard_error,
    interval (lower and upper end, at the confidence level `level`, 0 to 1), level and bounds, if it applies
    also fixed (True), tied (expression), interval_systematic and interval_both; r_squared, rmse, unit and
    n_data. Other keys are the names of attributes of `Fit`, such as "failures", and "lack_of_fit".
    "reduced_chi_squared" is None if the noise was not given.
    """
    intervals, errors = fit.confidence_intervals(level), fit.standard_errors
    wider = systematic_numbers(fit, level)
    found = {
        "parameters": {
            p.name: {
                "value": fit.values[p.name],
                "unit": p.unit,
                "standard_error": errors[p.name],
                "interval": list(intervals[p.name]),
                "level": level,
                **({f"interval_{k}": list(v) for k, v in wider[p.name].items()} if wider else {}),
                "bounds": [p.lower, p.upper],
                **({"fixed": True} if p.fixed else {"tied": p.tied} if p.tied else {}),
            }
            for p in fit.shown
        },
        "undetermined": list(fit.undetermined),
        "correlation": fit.correlation.to_numpy().tolist(),
        "recordings": {
            g.name: {"r_squared": g.r_squared, "rmse": g.rmse, "unit": g.unit, "n_data": g.n_data}
            for g in fit.recordings
        },
        "r_squared": fit.r_squared,
        "aic": fit.aic,
        "bic": fit.bic,
        "n_data": fit.n_data,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "reduced_chi_squared": fit.reduced_chi_squared if fit.noise_known else None,
        "noise_known": fit.noise_known,
        "correlated": fit.correlated,
        "n_evaluations": fit.n_evaluations,
        "converged": fit.converged,
        "message": fit.message,
        "starts": fit.starts,
        "starts_agreeing": fit.starts_agreeing,
        "judgement": fit.judgement._asdict(),
        "lack_of_fit": [
            {
                "name": one.name,
                "ratio": one.ratio,
                "chance": one.chance,
                "against": one.against,
                "seen": one.seen,
                "sentence": one.sentence,
            }
            for one in fit.lack
        ],
        "disturbances": [{**one._asdict(), "sentence": one.sentence} for one in fit.disturbances],
        "failures": list(fit.failures),
        "systematics": [
            {"cause": one.cause, "uncertainty": one.uncertainty, "sentence": one.sentence}
            for one in fit.systematics
        ],
        "remarks": list(fit.remarks),
        "advice": None if fit.advice is None else fit.advice.to_dict(),
        "minima": [{"values": m.values, "excess": m.excess} for m in fit.minima],
    }
    return _finite(found)


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _finite(item: Any) -> Any:
    """Return the item, a nest of dictionaries and lists, with None in place of NaN and infinity, which JSON
    does not have."""
    if isinstance(item, dict):
        return {key: _finite(value) for key, value in item.items()}
    if isinstance(item, list):
        return [_finite(value) for value in item]
    return None if isinstance(item, float) and not math.isfinite(item) else item
