"""Checks for models that cannot follow a jump of the drive."""

from __future__ import annotations

from ..friction import elements
from ..physics.actuator import Actuator
from ..quantities.units import QuantityError
from ..waveform.drive import Drive, value_slope_curvature
from .two_port import driven_by_voltage

STATIC_JUMPS = (
    "a static stage jumps with the voltage, at infinite speed, at which a presliding law has no meaning"
)
INSTEAD = "give the stage a natural_frequency, or a drive without jumps (a rise_fraction < 1)"


def cannot_jump(model: Actuator) -> bool:
    """Return True if a voltage jump would move the bristles of a static stage's contact at infinite speed.

    Such a model accepts no drive with jumps. A law without bristles has no such limit: its contact just
    slides.
    """
    return model.static and not model.clamped and elements(model.friction) > 0


def refuse_jumps(model: Actuator, table: Drive, period: float | None) -> None:
    """Raise QuantityError if the drive jumps, and the model has a static stage whose contact has bristles, or
    a `MaxwellCapacitor` under voltage control.

    Args:
        model: the actuator.
        table: segment table of the drive, V.
        period: period of the drive, s; None if it does not repeat. A jump from one period to the next counts,
            too.
    """
    if driven_by_voltage(model) and _jumps(table, period):
        raise QuantityError(
            "a piezo with a MaxwellCapacitor would take an infinite current at a jump of the voltage: give "
            "the waveform a finite fall (rise_fraction < 1), or the amplifier's output "
            "(stickslip.physics.electronics.driven)"
        )
    if cannot_jump(model) and _jumps(table, period):
        raise QuantityError(f"{STATIC_JUMPS}: {INSTEAD}")


def _jumps(table: Drive, period: float | None) -> bool:
    """Return True if the drive jumps from one segment to the next, or at its start. Given a `period` [s], the
    value before the start is that at the end of the period."""
    starts = [value_slope_curvature(table, i, t)[0] for i, t in enumerate(table.start)]
    ends = [value_slope_curvature(table, i, t)[0] for i, t in enumerate(table.start[1:])]
    first = table.before if period is None else value_slope_curvature(table, len(starts) - 1, period)[0]
    size = max(map(abs, (first, *starts, *ends)))
    return any(abs(a - b) > 1e-9 * size for a, b in zip((first, *ends), starts, strict=True))
