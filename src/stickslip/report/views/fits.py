"""View of a fit: its parameters, and its recordings compared with the model."""

from __future__ import annotations

from ...estimate.result import Fit
from ...identify.results import model_numbers
from ...physics.actuator import Actuator
from ..document import Column, Document, Picture, Section, Table
from ..figures.fits import called, draw_fit
from ..figures.style import svg
from ..fits import estimates, fit_numbers, fit_summary, parameter_table
from ..thresholds import judgement_section
from ..viewing import document_of

MOST_DRAWN = 8  # largest number of recordings with a figure; a fit of more recordings has no figure


@document_of.register
def fit_document(fit: Fit) -> Document:
    """Return a document with parameters and their intervals, and each recording compared with the model."""
    count, unit = len(fit.recordings), fit.recordings[0].unit
    numbers = fit_numbers(fit, unit)
    if isinstance(fit.model, Actuator):
        numbers["model"] = model_numbers(fit.model)
    return Document(
        title="Identification",
        summary=fit_summary(fit, count, fit.failures),
        sections=(
            Section("Parameters", tables=(parameter_table("Identified parameters.", fit),)),
            Section("Recordings", tables=(goodness_table(fit),), figures=_pictures(fit)),
            judgement_section(fit.judgement),
        ),
        highlights=list(estimates(fit).items()),
        numbers=numbers,
        failures=fit.failures,
    )


def goodness_table(fit: Fit) -> Table:
    """Return a table of r² and rms error (in the channel's unit), one row for each recording of a fit."""
    columns = (Column("recording"), Column("r²", "", 5), Column("rms error", fit.recordings[0].unit, 3))
    rows = [(one.name, one.r_squared, one.rmse) for one in fit.recordings]
    return Table("Coefficient of determination, rms error.", columns, rows)


def _pictures(fit: Fit) -> list[Picture]:
    """Return a list with one picture of all recordings with the model.

    The list is empty for more than `MOST_DRAWN` recordings, or for recordings that are not over time.
    """
    over_time = all(t.size and t.size == r.size for t, r in zip(fit.times, fit.residuals, strict=True))
    if not over_time or len(fit.recordings) > MOST_DRAWN:
        return []
    name = called(fit.observed)
    caption = f"{name[0].upper()}{name[1:]}, measured and by the model, and the residuals."
    return [Picture("fit", caption, svg(draw_fit(fit).flat[0].figure), f"{name} over time, and residuals")]
