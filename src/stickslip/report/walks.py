"""Report of a fit to walks: its parameters, and every walk, fitted or not, with the prediction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, NamedTuple

from ..estimate.result import Fit
from ..identify.results import model_numbers
from ..identify.verification import verify
from ..physics.actuator import Actuator
from ..quantities.progress import Progress, unheard
from ..quantities.units import near_one
from ..waveform.signal import Waveform
from .document import Column, Document, Number, Section, Table
from .figures.fits import called
from .fits import estimates, fit_numbers, fit_summary, parameter_table, prediction_picture
from .origin import origin_of
from .thresholds import judgement_section

if TYPE_CHECKING:
    import xarray as xr

_ROLE = {"fit": "fitted", "verify": "predicted"}


class UsedWalk(NamedTuple):
    """A recording of a walk, and its use: "fit" if it was fitted, "verify" if it is only predicted.

    `drive` replaces the recorded drive voltage in the prediction; None: the recorded drive is taken.
    """

    use: Literal["fit", "verify"]
    recording: xr.Dataset
    drive: Waveform | None = None


def walk_document(
    title: str,
    fit: Fit,
    model: Actuator,
    walks: Mapping[str, UsedWalk],
    notes: str = "",
    progress: Progress = unheard,
) -> Document:
    """Return the report of a fit to walks: its parameters, and each recording with the model's prediction.

    Failures are those of the fit, and statements on walks of the use "verify" that the model does not
    explain.

    Args:
        title: title of the report.
        fit: the fit.
        model: initial model of the fit, whose assumptions and citations are listed.
        walks: all recordings by name, fitted or only predicted; each is predicted again.
        notes: a paragraph for the section of the parameters; "" for none.
        progress: called before each prediction with the activity in words, and the finished fraction of the
            walks, from 0 up to below 1.
    """
    rows, pictures, numbers = [], [], {}
    unit = fit.recordings[0].unit
    taken, failures = [], list(fit.failures)
    for i, (label, walk) in enumerate(walks.items()):
        progress(f"predicting {label}", i / len(walks))
        seen = verify(fit, walk.recording.assign_attrs(title=label), drive=walk.drive)
        good, shown = seen.recordings[0], seen.predictions[0]
        taken += seen.taken
        failures += seen.statements if walk.use == "verify" else ()
        rows.append((label, walk.use, good.r_squared, good.rmse))
        numbers[f"recording_{i + 1}"] = {
            "r_squared": Number(good.r_squared, "", note=label),
            "rmse": Number(good.rmse, unit),
        }
        caption = f"{label}: end-effector position, measured and {_ROLE[walk.use]}."
        pictures.append(prediction_picture(f"walk_{i + 1}", caption, shown, called(seen.observed), unit))
    unseen = [r[2] for r in rows if r[1] == "verify"]
    verified = ""
    if unseen:
        verified = f" On {len(unseen)} that it has not seen, r² is {near_one(min(unseen))} or more."
    origin = origin_of(
        model, [walk.recording for walk in walks.values()], [p.name for p in fit.shown if not p.fixed]
    )
    columns = Column("recording"), Column("role"), Column("r²", "", 5), Column("rms error", unit, 3)
    return Document(
        title=title,
        summary=fit_summary(fit, len(rows) - len(unseen), failures, verified),
        sections=(
            Section(
                "Parameters",
                tables=(parameter_table("Identified parameters.", fit),),
                paragraphs=(notes,) if notes else (),
            ),
            Section(
                "Recordings",
                points=taken,
                tables=(Table("Coefficient of determination, rms error.", columns, rows),),
                figures=pictures,
            ),
            judgement_section(fit.judgement),
        ),
        highlights=list(estimates(fit).items()),
        numbers={
            **fit_numbers(fit, unit),
            "recordings": numbers,
            "drives": taken,
            "model": model_numbers(fit.model),
        },
        assumptions=origin.assumptions,
        citations=origin.citations,
        failures=failures,
    )
