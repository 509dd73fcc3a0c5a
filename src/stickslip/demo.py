"""The demonstration: the thesis's actuator simulated, then models identified from published measurements.

Each part is an identification file of `stickslip.examples`, run as ``stickslip identify`` would run it. A
part whose data can neither be found nor fetched is said to be missing, and why.
"""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from .actuator import load_actuator
from .recording import RecordingError
from .report import Document, Number, Section
from .report.trajectory import trajectory_document
from .simulation import simulate, steady_step
from .study import run_file
from .study.running import Progress
from .waveform.periodic import ReverseSawtooth, Sawtooth

EXAMPLES = ("friction_loops.yaml", "piezo_mirror.yaml", "pulled_slider.yaml")


def run(progress: Progress | None = None) -> Document:
    """Simulate and identify everything; see the module."""
    tell = progress or (lambda doing, done: None)
    tell("simulating the actuator of the thesis", 0.0)
    parts = [_thesis()]
    missing = []
    folder = Path(str(importlib.resources.files("stickslip") / "examples"))
    for i, name in enumerate(EXAMPLES):
        begin, share = (1 + i) / (1 + len(EXAMPLES)), 1 / (1 + len(EXAMPLES))
        try:
            parts.append(
                run_file(folder / name, lambda doing, done, b=begin, s=share: tell(doing, b + s * done))
            )
        except RecordingError as error:
            missing.append(f"{name} could not be run: {error}")
    sections = [_as_section(part) for part in parts]
    if missing:
        sections.append(Section("Parts that are missing", points=missing))
    return Document(
        title="stickslip: demonstration",
        summary=" ".join(
            (
                "The actuator of Kang's thesis, simulated from its parameter set; then models identified "
                "from measurements that others have published, and verified on parts that no fit has seen.",
                *missing,
            )
        ),
        sections=sections,
        highlights=[highlight for part in parts for highlight in part.highlights[:2]],
        numbers={_key(part.title): part.numbers for part in parts},
        assumptions=list(dict.fromkeys(a for part in parts for a in part.assumptions)),
        citations="\n\n".join(dict.fromkeys(part.citations for part in parts if part.citations)),
    )


def _within(tell: Progress, begin: float, share: float) -> Progress:
    return lambda doing, done: tell(doing, begin + share * done)


def _thesis() -> Document:
    """The thesis's model: the reaction of the friction on the stage is left out, as in its eq. 3.24."""
    model = load_actuator("kang2007").replace(stage_reaction=False)
    drive = Sawtooth(amplitude=65.0, frequency=5.0, periods=8)
    trajectory = simulate(model, drive)
    backward = steady_step(model, ReverseSawtooth(amplitude=65.0, frequency=5.0))
    document = trajectory_document(model, drive, trajectory, Number(steady_step(model, drive), "m"))
    return Document(
        title="The actuator of the thesis",
        summary=f"{document.summary} The reverse saw-tooth moves it {1e6 * backward:.3g} µm per period.",
        sections=document.sections,
        highlights=[h for h in document.highlights if "step" in h[0]] or document.highlights,
        numbers={**document.numbers, "steady_step_backward": Number(backward, "m")},
        assumptions=document.assumptions,
        citations=document.citations,
    )


def _as_section(part: Document) -> Section:
    return Section(part.title, paragraphs=(part.summary,), sections=part.sections)


def _key(title: str) -> str:
    return "_".join("".join(c if c.isalnum() else " " for c in title.lower()).split())
