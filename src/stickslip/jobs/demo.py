"""Demonstration: the campaign of [kang2007] on the virtual rig, and models of published measurements.

The campaign and the identification files come from `stickslip.examples`; they run as with ``stickslip
campaign`` and ``stickslip identify``. If the data of a part are missing and cannot be downloaded, the report
says which and why.
"""

from __future__ import annotations

import contextlib
import importlib.resources
import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..quantities.progress import Progress, unheard, within
from ..recording import RecordingError
from ..report import Document, Section
from ..study.local import sigint_blocked
from .analysis import run_file
from .campaign import run_campaign
from .running import joined

CAMPAIGN = "kang2007_campaign.yaml"
EXAMPLES = ("friction_loops.yaml", "piezo_mirror.yaml", "pulled_slider.yaml")
# Fraction of the demonstration's progress at which the campaign is finished.
_CAMPAIGN_SHARE = 0.6


@contextlib.contextmanager
def _others() -> Iterator[ProcessPoolExecutor]:
    """Provide an executor with two processes for a `with` block; an error or Ctrl-C ends the processes at
    once."""
    before = multiprocessing.active_children()
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as others:
        try:
            yield others
        except BaseException:
            for process in multiprocessing.active_children():
                if process not in before:
                    process.terminate()
            raise


def _run_or_why(file: Path) -> Document | str:
    """Return the report of an identification file, or the message of the RecordingError if data are
    missing."""
    try:
        return run_file(file)
    except RecordingError as error:
        return str(error)


def run(out: str | os.PathLike[str], progress: Progress = unheard) -> Document:
    """Run the demonstration and return its report.

    Two other processes run the identification files while this one runs the campaign. A part whose data are
    missing is left out, with the reason in the report.

    Args:
        out: folder for the campaign's recordings and finished stages; existing ones are used again.
        progress: called with the current activity and the finished fraction, from 0 to 1.
    """
    folder = Path(str(importlib.resources.files("stickslip") / "examples"))
    with _others() as others:
        with sigint_blocked():
            begun = [others.submit(_run_or_why, folder / name) for name in EXAMPLES]
        campaign = run_campaign(folder / CAMPAIGN, out, partial(within, progress, 0.0, _CAMPAIGN_SHARE))
        found = []
        for k, name in enumerate(EXAMPLES):
            progress(name, _CAMPAIGN_SHARE + (1.0 - _CAMPAIGN_SHARE) * k / len(EXAMPLES))
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
