"""Report section on hysteresis and creep of the stage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...report import Section
from ...report.fits import parameter_table
from ...report.piezo import hysteresis_pictures
from .hysteresis import Hysteresis

if TYPE_CHECKING:
    import xarray as xr


def hysteresis_section(of: Hysteresis, used: Sequence[xr.Dataset], figures: bool) -> Section:
    """Return the report section: parameters of the fit, figures, and the need for hysteresis and creep.

    Args:
        of: identified hysteresis and creep.
        used: recordings of the fit.
        figures: True to draw figures.
    """
    said = f"{of.sentence[0].upper()}{of.sentence[1:]}."
    return Section(
        "Hysteresis and creep",
        paragraphs=(
            f"Plays and creep fitted to {of.fit.observed}, the end-effector fixed to the stage; the steps "
            "then give mode and gain of the stage behind them, each step from a long rest.",
            said,
            f"How sure they are is told by {len(of.stages)} stages that the recordings give without a part "
            "of each: what they make of steps and walks differently is part of the intervals below.",
        ),
        tables=(parameter_table("Plays, creep, and how late the channel is.", of.fit),),
        figures=hysteresis_pictures(of.fit, used, "campaign-hysteresis") if figures else [],
    )
