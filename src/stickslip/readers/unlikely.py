"""Numbers without a unit that cannot be in SI."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..recording import RecordingError
from .clocks import Clocked
from .selection import Selection, Variable

# What no stick-slip actuator does, nor the instruments around it: largest size in SI, and likely units.
UNLIKELY = {
    "m": (0.2, "um or nm"),
    "V": (2e3, "mV"),
    "N": (1e4, "mN"),
    "m/s": (20.0, "mm/s"),
}
LONGEST_STEP, FEW = 1.0, 10  # s from sample to sample, of more than these


def refuse_unlikely(chosen: Selection, groups: Sequence[Clocked]) -> None:
    """Ask for the unit where nobody says one and the numbers are not likely to be in SI.

    Raises:
        RecordingError: names the column, the size as it would be in SI, and what to say.
    """
    for group, clock in zip(groups, chosen.clocks.values(), strict=True):
        step = float(np.median(np.diff(group.time))) if group.time.size > FEW else 0.0
        if clock is not None and not clock.unit and step > LONGEST_STEP:
            raise _unlikely(clock, f"as seconds they are {step:.4g} s apart", "ms or us", "s")
        for variable in chosen.variables:
            limit, likely = UNLIKELY.get(variable.conversion.unit, (np.inf, ""))
            values = group.values.get(variable.name)
            if values is None or not values.size or (variable.unit and variable.sure):
                continue
            span = float(np.nanmax(values) - np.nanmin(values))
            if span > limit:
                unit = variable.conversion.unit
                raise _unlikely(variable, f"as {unit} they go over {span:.4g} {unit}", likely, unit)


def _unlikely(variable: Variable, size: str, likely: str, unit: str) -> RecordingError:
    said = f"units={{{variable.name!r}: ...}}"
    who = "only the end of the name says a unit" if variable.unit else "no unit is said with the numbers"
    return RecordingError(
        f"{variable.label}: {who}, and {size}. Say {said}, {likely} perhaps, or {unit!r} if it is so"
    )
