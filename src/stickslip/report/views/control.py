"""View of a tuning: gains, filters and margins."""

from __future__ import annotations

from ...control import Tuning
from ...quantities.units import with_prefix
from ..document import Document, Number, Section
from ..viewing import document_of


@document_of.register
def tuning_document(tuning: Tuning, unit: str = "m") -> Document:
    """Return a document with the tuned regulator: integral gain, filters, and the margins for all models.

    `unit` is the unit of positions, m or rad.
    """
    filters = [f"notch at {with_prefix(n.frequency, 'Hz')}, width {n.width:g}" for n in tuning.notches]
    if tuning.low_pass is not None:
        filters.append(f"low-pass at {with_prefix(tuning.low_pass.corner, 'Hz')}")
    margins = f"over {tuning.models} model{'s' * (tuning.models > 1)}: {tuning.margins.report()}"
    points = (f"integral gain {tuning.pid.integral:.4g} V/({unit} s)", *filters, margins)
    numbers = {
        "integral": Number(tuning.pid.integral, f"V/({unit} s)"),
        "sensitivity": Number(tuning.margins.sensitivity, ""),
        "gain_margin": Number(tuning.margins.gain_margin, ""),
        "phase_margin": Number(tuning.margins.phase_margin, "rad"),
        "crossover": Number(tuning.margins.crossover, "Hz"),
        "models": Number(tuning.models, ""),
    }
    return Document(
        title="Tuning of the loop",
        summary=f"{margins[0].upper()}{margins[1:]}.",
        sections=(Section("The loop", points=points),),
        highlights=[(name.replace("_", " "), numbers[name]) for name in ("crossover", "sensitivity")],
        numbers=numbers,
    )
