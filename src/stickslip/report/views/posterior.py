"""View of a posterior: mean and interval of each parameter, and the convergence of the sampling."""

from __future__ import annotations

from ...estimate.posterior import Posterior
from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.posterior import posterior_corner
from ..figures.style import svg
from ..viewing import document_of

MOST_DRAWN = 8  # largest number of parameters in the figure; further ones are not drawn


@document_of.register
def posterior_document(found: Posterior) -> Document:
    """Return a document with the parameters' distributions, and the convergence of the chains.

    Chains that have not converged are a failure.
    """
    numbers = posterior_numbers(found)
    message = f"{found.message[0].upper()}{found.message[1:]}."
    return Document(
        title="Posterior",
        summary=f"{len(numbers)} parameters sampled. {message}",
        sections=(Section("Posterior", tables=(posterior_table(found),), figures=(_picture(found),)),),
        highlights=list(numbers.items()),
        numbers={**numbers, "converged": found.converged, "message": found.message},
        failures=() if found.converged else (message,),
    )


def posterior_numbers(found: Posterior) -> dict[str, Number]:
    """Return mean, 95 % interval of highest density and standard deviation of each parameter, by name."""
    numbers = {}
    for name in map(str, found.summary["parameter"].values):
        row = found.summary.sel(parameter=name)
        ends = float(row["low"]), float(row["high"])
        unit = found.samples[name].attrs["units"]
        numbers[name] = Number(float(row["mean"]), unit, *ends, float(row["sd"]))
    return numbers


def posterior_table(found: Posterior) -> Table:
    """Return a table with one row per parameter: mean, 95 % interval, R-hat, and effective sample sizes.

    There is an effective sample size for the whole distribution, and one for its tails.
    """
    columns = (
        Column("parameter"),
        Column("mean [95 %, highest density]"),
        Column("R-hat", "", 4),
        Column("effective samples", "", 3),
        Column("in the tails", "", 3),
    )
    rows = []
    for name, number in posterior_numbers(found).items():
        row = found.summary.sel(parameter=name)
        rows.append((name, number, *(float(row[k]) for k in ("r_hat", "ess", "ess_tail"))))
    return Table("The posterior of all that was sampled.", columns, rows)


def _picture(found: Posterior) -> Picture:
    names = list(map(str, found.summary["parameter"].values))[:MOST_DRAWN]
    samples = {name: found.samples[name].values.ravel() for name in names}
    units = {name: str(found.samples[name].attrs["units"]) for name in names}
    return Picture(
        "posterior",
        "Each parameter alone, and by pairs: half and nine tenths of the samples within the lines.",
        svg(posterior_corner(samples, units)),
        "Histograms of each parameter and contours of each pair of them",
    )
