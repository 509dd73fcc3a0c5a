"""Report of a campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...estimate.lack import said
from ...estimate.systematic import intervals_with_systematics
from ...gate.results import json_attribute
from ...identify.results import chain_numbers, model_numbers
from ...quantities.units import near_one, with_prefix
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.document import in_turns
from ...report.figures.campaign import Trace, walks
from ...report.figures.style import svg
from ...report.fits import fit_numbers, lack_numbers, parameter_table
from ...report.origin import origin_of
from ...report.piezo import hysteresis_numbers
from ...report.recordings import recorded_assumptions
from ...report.views.verification import verification_numbers
from ...rig.experiment import Recorded
from ..analysis.alignment import POSITION, Aligned, said_drives, said_to_drift
from ..analysis.priors import with_priors
from .additional_sections import additional_numbers, additional_sections
from .bands import walk_bands
from .evaluation import CampaignResult
from .features import feature_numbers, features_section
from .file import CampaignFile
from .hysteresis_section import hysteresis_section
from .stage import stage_section, unit_of
from .stage_source import band_words, stage_heading, stage_words

_ROLE = {"piezo": "hysteresis and creep", "step": "stage", "fit": "friction, fitted", "verify": "predicted"}


def campaign_document(
    file: CampaignFile, found: CampaignResult, recorded: Sequence[Recorded], *, figures: bool = True
) -> Document:
    """Return the report of a campaign: procedure, results `found`, and their uncertainty.

    `recorded` are the records of the experiment's runs, [] without an experiment.
    """
    friction, seen = found.friction, found.verification
    both = intervals_with_systematics(friction, intervals=found.budget.intervals)
    numbers: dict[str, Any] = {
        "friction": {
            **fit_numbers(friction, "m"),
            "parameters_with_all_errors": {
                name: Number(
                    friction.values[name],
                    unit_of(friction, name),
                    *ends,
                    found.budget.total[name],
                    both=both.get(name),
                )
                for name, ends in found.budget.intervals.items()
            },
        },
        "verification": verification_numbers(seen),
        "all_walks_at_once": {
            **fit_numbers(found.everything.free, "m"),
            "lack_of_fit": lack_numbers(found.everything.lacks),
        },
        "model": model_numbers(friction.model),
        "parameters": {"delay": Number(friction.values["delay"], "s")},
        "features": feature_numbers(found.features),
        "signal_chain": chain_numbers(found.chain),
        "recordings": {
            one.name: {"start": Number(one.begin, "s"), "noise": Number(one.noise, "m")}
            for one in found.gathered
        },
        "published_r_squared": {name: Number(value, "") for name, value in file.published.items()},
        "required": list(file.require),
        **additional_numbers(found),
    }
    if found.stage is not None:
        numbers["stage"] = fit_numbers(found.widened_stage or found.stage, "m")
    if found.hysteresis is not None:
        numbers["hysteresis"] = hysteresis_numbers(found.hysteresis.fit, found.hysteresis.straight)
    if found.scale is not None:
        numbers["sensor_scale"] = Number(found.scale.value, "", standard_error=found.scale.standard_error)
    bands = _bands(file, found) if figures else None
    sections = [
        _set_up(file, found),
        _calibration(file, found),
        *_hysteresis(found, figures),
        *([stage_section(file, found, figures)] if found.stage is not None else []),
        features_section(found.features),
        _friction(file, found, bands),
        _verification(file, found, bands),
        *additional_sections(found, figures=figures),
    ]
    of_stage = found.stage.parameters if found.stage else ()
    fitted = {*file.free, *(file.tied or ()), *(p.name for p in of_stage)}
    origin = origin_of(friction.model, [one.recording for one in found.gathered], fitted)
    least = float(np.min(seen.table["r_squared"].values))
    errors = seen.table["net_step_error"].values
    known = errors[np.isfinite(errors)]
    steps = f" and the net step within {100 * known.max():.2g} %" if known.size else ""
    unseen = sum(one.use == "verify" for one in found.walks)
    lacking = [*dict.fromkeys(said((*friction.lack, *found.everything.lacks)))]
    if friction.advice is not None:
        lacking.append(friction.advice.sentence)
    if lacking and found.additional.choice is not None:
        lacking.append(f"of the models compared, {found.additional.choice.best} predicts unseen walks best")
    lacking += [*said_to_drift(found.walks), *found.additional.failures]
    scales = [one.sentence for one in friction.systematics]
    document = Document(
        title=file.title,
        summary=(
            f"Friction fitted to {len(found.walks) - unseen} of {len(found.walks)} walks, r² "
            f"{near_one(friction.r_squared)}; over all walks r² is {near_one(least)} or more{steps}."
            + "".join(f" {text[0].upper()}{text[1:]}." for text in (*lacking, *scales))
        ),
        sections=sections,
        highlights=[
            *((name, number) for name, number in numbers["friction"]["parameters_with_all_errors"].items()),
            ("r² of the fitted walk", Number(friction.r_squared, "")),
            ("least r² of all walks", Number(least, "")),
            ("rms error", Number(seen.rmse, "m")),
        ],
        numbers=numbers,
        assumptions=[*dict.fromkeys((*origin.assumptions, *_assumptions(file, recorded)))],
        citations=origin.citations,
        failures=found.failures,
    )
    document = with_priors(document, found.priors)
    return in_turns(document) if friction.model is not None and friction.model.rotary else document


def _hysteresis(found: CampaignResult, figures: bool) -> list[Section]:
    if found.hysteresis is None:
        return []
    used = [one.recording for one in found.gathered if one.use == "piezo"]
    return [hysteresis_section(found.hysteresis, used, figures)]


def _set_up(file: CampaignFile, found: CampaignResult) -> Section:
    rows = []
    for one in found.gathered:
        time = one.recording["time"].values
        rows.append(
            (
                one.name,
                _ROLE[one.use],
                str(one.recording.attrs.get("source", "")).rsplit("/", 1)[-1],
                time.size,
                float(np.median(np.diff(time))),
                float(time[-1] - time[0]),
                one.begin,
                one.noise if math.isfinite(one.noise) else None,
            )
        )
    first = found.gathered[0].recording
    processing = str(first.attrs.get("processing", ""))
    said = [file.notes] if file.notes else []
    if processing:
        said.append(f"The recordings: {processing}.")
    said.append(
        "Each starts where its drive_voltage matches the drive that was wanted; what lies more than "
        "5 % of the drive's duration behind its end is left out. The mean before the start is subtracted."
    )
    of_walks = (*said_drives(found.walks), *said_to_drift(found.walks))
    said += [f"{text[0].upper()}{text[1:]}." for text in of_walks]
    return Section(
        "Set-up and recordings",
        paragraphs=said,
        tables=(
            Table(
                "Recordings; the noise is the scatter (one standard deviation) before the drive starts.",
                (
                    Column("recording"),
                    Column("used for"),
                    Column("source"),
                    Column("samples", "", 6),
                    Column("interval", "s", 3),
                    Column("length", "s", 3),
                    Column("start", "s", 5),
                    Column("noise", "m", 3),
                ),
                rows,
            ),
        ),
    )


def _calibration(file: CampaignFile, found: CampaignResult) -> Section:
    rows = []
    for name, chain in _applied(found.gathered[0]).items():
        for one in chain:
            unit = str(one.get("y_unit", ""))
            errors = [
                None if one.get(key) is None else Number(float(one[key]), unit)
                for key in ("max_error", "rms_error")
            ]
            source = str(one.get("source", ""))
            rows.append(
                (name, str(one.get("name", "")), len(one.get("coefficients", ())) - 1, *errors, source)
            )
    tables = []
    if rows:
        columns = (
            Column("channel"),
            Column("calibration"),
            Column("order", ""),
            Column("largest error"),
            Column("rms error"),
            Column("source"),
        )
        tables.append(Table("Calibrations, applied in this order.", columns, rows))
    said = ["No calibration is recorded in the data."] if not rows else []
    if found.scale is not None:
        share = 100.0 * (found.scale.value - 1.0)
        more, error = "more" if share > 0 else "less", 100.0 * found.scale.standard_error
        known = f"standard error {error:.2g} %"
        if len(found.scale.ratios) == 1:
            known = "of one step, which does not tell how sure that is"
        said.append(
            f"On the clamped steps the position reads {abs(share):.3g} % {more} than {file.reference} "
            f"({known}); it is divided by {found.scale.value:.5f} from here on. A "
            "polynomial that is right within some micrometres over a millimetre may well be wrong by per "
            "cents in its slope, which is what a motion of some micrometres is multiplied by."
        )
    return Section("Calibration", paragraphs=said, tables=tables)


def _applied(one: Aligned) -> Mapping[str, Any]:
    found = json_attribute(one.recording.attrs, "calibration")
    return {name: chain for name, chain in found.items() if isinstance(chain, list)}


Bands = Mapping[str, Any]


def _bands(file: CampaignFile, found: CampaignResult) -> Bands:
    """Return the half widths of the 95 % prediction bands, m or rad, arrays [samples] by name of the walk.

    The mapping is empty for a friction law without derivatives.
    """
    stages = () if found.hysteresis is None else found.hysteresis.stages
    bands = walk_bands(found.friction, found.inherited, found.walks, file.known_slew_rate, stages)
    names = [one.name for one in found.walks]
    return {} if bands is None else dict(zip(names, bands, strict=True))


def _friction(file: CampaignFile, found: CampaignResult, bands: Bands | None) -> Section:
    fit, parts = found.friction, found.budget
    names = list(parts.total)
    rows = [
        (
            name,
            Number(fit.values[name], unit_of(fit, name), *parts.intervals[name]),
            *(Number(by[name], unit_of(fit, name)) for by in parts.sources.values()),
        )
        for name in names
    ]
    table = Table(
        "Friction parameters with 95 % intervals that hold all of these standard errors.",
        (
            Column("parameter"),
            Column("estimate [95 % interval]"),
            *(Column(stage_heading(file, found, source)) for source in parts.sources),
        ),
        rows,
        notes=" ".join(fit.undetermined),
    )
    pictures = []
    if bands is not None:
        pictures = [
            _walks_picture(
                file,
                found,
                bands,
                [one for one in found.walks if one.use == "fit"],
                "campaign-fit",
                "The walk that the friction was fitted to",
                whole=True,
            )
        ]
    return Section(
        "Friction, from a walk",
        paragraphs=(
            "Least squares over simulations of the whole walk, all raw samples.",
            stage_words(file, found),
        ),
        tables=(table, parameter_table("The fit itself, with delay and offset of the sensor.", fit)),
        figures=pictures,
    )


def _verification(file: CampaignFile, found: CampaignResult, bands: Bands | None) -> Section:
    table = found.verification.table
    published = [Column("r², published", "", 4)] if file.published else []
    rows = []
    for i, one in enumerate(found.walks):
        r_squared, rmse, step, error = (
            float(table[key][i]) for key in ("r_squared", "rmse", "net_step", "net_step_error")
        )
        known = math.isfinite(step)
        most = 1.0 - one.noise**2 / float(np.var(one.recording[POSITION].values)) if one.noise > 0 else None
        rows.append(
            (
                one.name,
                _ROLE[one.use],
                r_squared,
                *([file.published.get(one.name)] if published else []),
                most,
                rmse,
                step if known else None,
                100.0 * error if known else None,
            )
        )
    columns = (
        Column("recording"),
        Column("role"),
        Column("r²", "", 5),
        *published,
        Column("r² that noise allows", "", 5),
        Column("rms error", "m", 3),
        Column("net step, measured", "m", 4),
        Column("its error", "%", 2),
    )
    pictures = []
    if bands is not None:
        groups: dict[str, list[Aligned]] = {}
        for one in found.walks:
            if one.use == "verify":
                groups.setdefault(one.name.rpartition("_")[0] or "walks", []).append(one)
        for i, (name, group) in enumerate(groups.items()):
            said = f"{name[:1].upper()}{name[1:].replace('_', ' ')}: predicted, not fitted, and measured"
            pictures.append(
                _walks_picture(file, found, bands, group[:4], f"campaign-predicted-{i + 1}", said)
            )
    return Section(
        "Verification",
        paragraphs=("What was fitted predicts the other walks; nothing is fitted again.",),
        points=[f"required: {text}" for text in file.require],
        tables=(
            Table(
                "Measured and predicted walks.",
                columns,
                rows,
                notes="r² = (SST − SSE)/SST. The noise before the drive starts "
                "allows no more than the r² beside it, and the less the smaller the walk.",
            ),
        ),
        figures=pictures,
    )


def _walks_picture(
    file: CampaignFile,
    found: CampaignResult,
    bands: Bands,
    shown: Sequence[Aligned],
    name: str,
    said: str,
    *,
    whole: bool = False,
) -> Picture:
    """Return the figure `name` of the walks `shown`, measured and predicted, with residuals and `bands`.

    `bands` are those of `_bands`, and `said` starts the caption. Unless `whole`, only the first part of each
    drive (forward) is shown.
    """
    traces = {}
    for one in shown:
        p = found.verification.predictions[[w.name for w in found.walks].index(one.name)]
        time = p["time"].values
        end = math.inf if whole or one.forward is None else one.forward
        near = time <= end
        traces[one.name.replace("_", " ")] = Trace(
            time[near],
            p["measured"].values[near],
            p["predicted"].values[near],
            np.hypot(1.96 * found.friction.rmse, bands[one.name][near] if bands else 0.0),
            bands[one.name][near] if bands else 0.0,
        )
    return Picture(
        name,
        f"{said}; below, the residuals, and where 95 % of the model and of new samples should be by "
        f"{band_words(file, found, drawn=bool(bands))}.",
        svg(walks(traces, found.verification.unit)),
        "Position over time, measured under the model, and the residuals below",
    )


def _assumptions(file: CampaignFile, recorded: Sequence[Recorded]) -> list[str]:
    said = []
    if file.known_slew_rate is not None:
        words = file.slew_rate_source or "as the campaign file says"
        said.append(f"slew_rate = {with_prefix(file.slew_rate, 'V/s')}: {words}")
    if file.filter is not None:
        said.append(f"filter of the position = order {file.filter.order}, {file.filter.corner}: as recorded")
    said.append("one delay of the position sensor for all walks")
    return [*said, *(recorded_assumptions(recorded) if recorded else [])]
