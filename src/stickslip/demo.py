"""The demonstration: the thesis's campaign on the virtual rig, then models of published measurements.

The campaign is the one of `stickslip.examples`, and so are the identification files, each run as
``stickslip identify`` would run it. A part whose data can neither be found nor fetched is said to be missing,
and why.
"""

from __future__ import annotations

import importlib.resources
import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
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


def _run_or_why(file: Path) -> Document | str:
    """The document of an identification file, or why its data are missing."""
    try:
        return run_file(file)
    except RecordingError as error:
        return str(error)


def run(out: str | os.PathLike[str], progress: Progress = unheard) -> Document:
    """Run everything; the campaign's recordings go into `out`, and are kept there for the next time.

    Two other processes run the identification files meanwhile.
    """
    folder = Path(str(importlib.resources.files("stickslip") / "examples"))
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as others:
        begun = [others.submit(_run_or_why, folder / name) for name in EXAMPLES]
        campaign = run_campaign(folder / CAMPAIGN, out, partial(within, progress, 0.0, 0.6))
        found = []
        for k, name in enumerate(EXAMPLES):
            progress(name, 0.6 + 0.4 * k / len(EXAMPLES))
            found.append(begun[k].result())
    progress("done", 1.0)
    parts = [campaign, *(one for one in found if isinstance(one, Document))]
    missing = {name: one for name, one in zip(EXAMPLES, found, strict=True) if isinstance(one, str)}
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
