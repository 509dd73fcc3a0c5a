"""Report of an experiment: its recordings, together and in detail."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..gate.results import json_attribute
from ..physics.actuator import load_actuator
from ..quantities.units import with_prefix
from ..recording import open_recording
from ..rig import load_bench
from ..rig.experiment import Recorded
from .document import Column, Document, Listing, Number, Picture, Section, Table
from .figures.recordings import recording_detail, recordings_together
from .figures.style import svg

if TYPE_CHECKING:
    import xarray as xr

_MOST_LINES = 7  # largest number of recordings that are drawn together, a line for each
_BEFORE, _AFTER = 3e-3, 7e-3  # times before and after the trigger that the figure of the detail shows, s


def recordings_document(title: str, recorded: Sequence[Recorded], log: Path) -> Document:
    """Return the report on the recordings of an experiment.

    Args:
        title: title of the experiment.
        recorded: result of `run_experiment`, one recording or more; the recordings are read from their files.
        log: path of the experiment's log file, whose text is shown.
    """
    data = {one.cell.name: open_recording(one.path) for one in recorded}
    sections, numbers = [], {}
    for run in dict.fromkeys(one.cell.run for one in recorded):
        names = [one.cell.name for one in recorded if one.cell.run == run]
        sections.append(_section(run, {name: data[name] for name in names}))
    for name, recording in data.items():
        numbers[name] = {
            variable: Number(_span(values.values), values.attrs["units"], note="largest less least value")
            for variable, values in recording.data_vars.items()
        }
    kept = sum(one.kept for one in recorded)
    seconds = sum(one.cell.capture.length for one in recorded)
    summary = f"{len(recorded)} recordings, {with_prefix(seconds, 's')} in all"
    summary += f"; {kept} of them were there already." if kept else "."
    actuator = recorded[0].cell.actuator
    return Document(
        title=title,
        summary=summary,
        sections=[*sections, Section("Log", listings=(Listing(log.name, log.read_text(encoding="utf-8")),))],
        highlights=(("recordings", Number(len(recorded), "")),),
        numbers=numbers,
        assumptions=recorded_assumptions(recorded),
        citations=load_actuator(actuator.name).citation if actuator.name else "",
    )


def recorded_assumptions(recorded: Sequence[Recorded]) -> list[str]:
    """Return the assumptions about actuator and bench of an experiment, as texts "field = words".

    They are those of the first recording's actuator, and of the bench that this recording names, if any.
    """
    found = [f"{field} = {words}" for field, words in recorded[0].cell.actuator.assumptions.items()]
    bench = recorded[0].cell.bench
    if bench:
        found += [f"{field} = {words}" for field, words in load_bench(bench).assumptions.items()]
    return found


def _section(run: str, recordings: dict[str, xr.Dataset]) -> Section:
    shown = dict(list(recordings.items())[:_MOST_LINES])
    name, first = next(iter(recordings.items()))
    capture = json_attribute(first.attrs, "capture")
    trigger = round(capture["pre_trigger"] / capture["interval"]) * capture["interval"]
    begin, end = max(trigger - _BEFORE, 0.0), trigger + max(_AFTER, 10 * capture["interval"])
    variables = list(map(str, first.data_vars))
    spans = [
        [cell, *(Number(_span(r[v].values), r[v].attrs["units"]) for v in variables)]
        for cell, r in recordings.items()
    ]
    label = run.lower().replace(".", "-")
    return Section(
        run,
        paragraphs=(f"Processing: {first.attrs['processing']}.",),
        tables=(
            Table(
                "Range of each channel: its largest value less its smallest.",
                (Column("recording"), *(Column(v.replace("_", " ")) for v in variables)),
                spans,
            ),
        ),
        figures=(
            Picture(
                f"{label}-together",
                f"Recordings of {run}" + ("." if len(shown) == len(recordings) else ", the first of them."),
                svg(recordings_together(shown)),
                f"Channels over time of {', '.join(shown)}",
            ),
            Picture(
                f"{label}-detail",
                f"{name} around its trigger (the line), sample by sample: steps of the converters, noise, "
                "and the delay of the sensors.",
                svg(recording_detail(first, begin, end, trigger)),
                f"Channels of {name} over some milliseconds",
            ),
        ),
    )


def _span(values: np.ndarray) -> float:
    return float(np.ptp(values))
