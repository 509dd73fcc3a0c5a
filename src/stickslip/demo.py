"""The demonstration: the thesis's campaign on the virtual rig, then models of published measurements.

The campaign is the one of `stickslip.examples`, and so are the identification files, each run as
``stickslip identify`` would run it. A part whose data can neither be found nor fetched is said to be missing,
and why.
"""

from __future__ import annotations

import importlib.resources
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from .analysis import run_file
from .campaign import run_campaign
from .job.running import joined
from .progress import Progress, unheard, within
from .recording import RecordingError
from .report import Document, Section

CAMPAIGN = "kang2007_campaign.yaml"
EXAMPLES = ("friction_loops.yaml", "piezo_mirror.yaml", "pulled_slider.yaml")
# Of the time that all takes.
_CAMPAIGN_SHARE = 0.5


def run(out: str | os.PathLike[str], progress: Progress = unheard) -> Document:
    """Run everything; the campaign's recordings go into `out`, and are kept there for the next time."""
    folder = Path(str(importlib.resources.files("stickslip") / "examples"))
    share = (1.0 - _CAMPAIGN_SHARE) / max(len(EXAMPLES), 1)
    tasks: list[tuple[str, float, float, Callable[[Progress], Document]]] = [
        (CAMPAIGN, 0.0, _CAMPAIGN_SHARE, partial(run_campaign, folder / CAMPAIGN, out))
    ]
    for i, name in enumerate(EXAMPLES):
        tasks.append((name, _CAMPAIGN_SHARE + i * share, share, partial(run_file, folder / name)))
    parts, missing = [], dict[str, str]()
    for name, begin, length, task in tasks:
        try:
            parts.append(task(partial(within, progress, begin, length)))
        except RecordingError as error:
            missing[name] = str(error)
    title = "stickslip: demonstration"
    notes = (
        "The campaign of Kang's thesis on a virtual rig, from eleven recordings to a verified model; then "
        "models identified from measurements that others have published, and verified on parts that no fit "
        "has seen."
    )
    if not missing:
        return joined(title, notes, parts, told=False)
    notes += f" Left out, for their data are neither here nor to be fetched: {', '.join(missing)}."
    found = joined(title, notes, parts, told=False)
    reasons = Section("Parts that are missing", points=[f"{name}: {why}" for name, why in missing.items()])
    return replace(found, sections=[*found.sections, reasons])
