"""A document that uses everything a document can hold."""

from __future__ import annotations

import math

from stickslip.report import Column, Document, Listing, Number, Picture, Section, Table
from stickslip.report.figures.style import drawn, panels, svg


@drawn
def _drawing():
    figure, (axes,) = panels([1.5])
    axes.plot([0.0, 1.0], [0.0, 1.0])
    axes.set_xlabel("time (s)")
    return figure


def sample() -> Document:
    """Two pictures from the same drawing, so that their inner identifiers would clash."""
    drawing = svg(_drawing())
    table = Table(
        "Laws <ranked> & compared.",
        [
            Column("law"),
            Column("parameters", ""),
            Column("r²", "", 5),
            Column("rms residual", "N"),
            Column("value"),
        ],
        [
            ["LuGre", 5, 0.99652, 0.0251, Number(1.399e6, "N/m", 1.380e6, 1.418e6)],
            ["user's <own>", 2, math.nan, 0.0312, Number(math.nan, "N/m", note="not determined")],
        ],
        notes="r² of the predicted part.",
    )
    inner = Section(
        "Held-out part", paragraphs=["Free running."], figures=[Picture("loop", "Loop.", drawing, "a loop")]
    )
    return Document(
        title="Friction & piezo",
        summary='Laws were fitted <b>"free"</b> running.',
        sections=[
            Section(
                "Friction loops",
                paragraphs=["First.", "Second, with x < y."],
                points=["sigma_1 is not determined"],
                tables=[table],
                figures=[Picture("trace", "Trace of <force>.", drawing, 'force over "time"')],
                listings=[Listing("Experiment file", "fit:\n  - sigma_0 # <start>")],
                sections=[inner],
            ),
            Section("Thesis actuator"),
        ],
        highlights=[("r², predicted", Number(0.99652, "")), ("net displacement", Number(2.883e-5, "m"))],
        numbers={"friction": {"sigma_0": Number(1.399e6, "N/m", 1.380e6, 1.418e6, 9.7e3)}, "law": "LuGre"},
        assumptions=["end_effector_mass = 0.1 kg: brass"],
        citations="@misc{kang2007,\n  title = {Modeling},\n}",
    )
