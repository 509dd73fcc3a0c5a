"""Report section on the stage as identified from step responses."""

from __future__ import annotations

from ...estimate.result import Fit
from ...identify.step.fit import step_level
from ...quantities.units import near_one
from ...report import Column, Number, Picture, Section, Table
from ...report.figures.campaign import Trace, step_responses
from ...report.figures.style import svg
from ...report.fits import parameter_table
from .bands import step_bands
from .evaluation import CampaignResult
from .file import CampaignFile
from .gathering import POSITION

# Part of a step response that is shown before the step, as a fraction of the fitted time after the step. The
# fitted time is longer for a slower stage.
_BEFORE = 0.225


def unit_of(fit: Fit, name: str) -> str:
    """Return the unit of the parameter `name` of a fit, such as "N s/m"."""
    return next(p.unit for p in fit.shown if p.name == name)


def stage_section(file: CampaignFile, found: CampaignResult, figures: bool) -> Section:
    """Return the report section of a campaign with steps: fit of the steps, and the classical formulas beside
    it."""
    stage = found.stage
    assert stage is not None
    assert stage.predict is not None
    steps = [one for one in found.gathered if one.use == "step"]
    pictures = []
    if figures:
        traces = {}
        for i, (one, (samples, band)) in enumerate(zip(steps, step_bands(stage, steps), strict=True), 1):
            since = one.recording["time"].values[samples] - one.begin
            shown = since > -_BEFORE * since[-1]
            samples, band, since = samples[shown], band[shown], since[shown]
            traces[one.name.replace("_", " ")] = Trace(
                since,
                one.recording[POSITION].values[samples],
                stage.predict(one.recording)[samples] + step_level(stage.values, i, since),
                parameters=band,
            )
        pictures.append(
            Picture(
                "campaign-steps",
                "Step responses, measured and by the second-order stage.",
                svg(step_responses(traces, stage.recordings[0].unit)),
                "Position over the milliseconds after a step, measured and model, and the residuals below",
            )
        )
    published = file.published.get("step")
    beside = f" Published: r² {published:.4f}." if published is not None else ""
    return Section(
        "Stage, from steps",
        paragraphs=(
            f"All samples of {len(steps)} step{'s at once' if len(steps) > 1 else ''}, the end-effector "
            f"fixed to the stage: r² {near_one(stage.r_squared)}.{beside}",
        ),
        tables=(
            parameter_table("Second-order stage, delay and lag of the sensor.", found.widened_stage or stage),
            _formulas(found, stage),
        ),
        figures=pictures,
    )


def _formulas(found: CampaignResult, stage: Fit) -> Table:
    """Return a table that compares the classical formulas (peak time, overshoot) with the fit."""
    known = found.formulas
    assert known is not None
    rows = []
    for i, name in enumerate(known["parameter"].values):
        unit = unit_of(stage, str(name))
        columns = ("fitted", "by_sensor", "by_noise", "scatter")
        rows.append((str(name), *(Number(float(known[c][i]), unit) for c in columns)))
    return Table(
        "What the formulas of peak time and overshoot make of the same steps.",
        (
            Column("parameter"),
            Column("fitted"),
            Column("formula off by the sensor"),
            Column("by the noise"),
            Column("scatter of the formula"),
        ),
        rows,
        notes="The sensor's lag and filter move the peak; the greatest of many noisy samples is too great.",
    )
