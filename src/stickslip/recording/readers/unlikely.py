"""Checks of read values: errors for values that are implausible in their unit, warnings for values without a
unit."""

from __future__ import annotations

import warnings
from collections.abc import Container, Sequence
from pathlib import Path

import numpy as np

from .. import RecordingError, RecordingWarning
from .clocks import Clocked
from .preview import LOOKED_AT, likely_unit
from .selection import FileVariable, Selection
from .source import FileChannel, no_numbers

# UNLIKELY: largest plausible range (maximum minus minimum) of a channel of a stick-slip actuator, by SI unit,
# and the unit that numbers with a larger range probably have.
UNLIKELY = {
    "m": (0.2, "um or nm"),
    "V": (2e3, "mV"),
    "N": (1e4, "mN"),
    "m/s": (20.0, "mm/s"),
}
# Largest plausible median sampling interval, s: LONGEST_STEP for a time column without a unit,
# LONGEST_SAID_STEP for one with a unit in the file. Only recordings with more than FEW samples are checked.
LONGEST_STEP, LONGEST_SAID_STEP, FEW = 1.0, 30.0, 10


def refuse_unlikely(chosen: Selection, groups: Sequence[Clocked], units: Container[str]) -> None:
    """Raise an error that asks for the unit if a channel's range or the median sampling interval is
    implausibly large, even if the file states the unit; dates are not checked.

    Args:
        chosen, groups: selected channels, and their values in SI grouped by clock, in the order of
            `chosen.clocks`.
        units: names of variables whose unit the user has given, which are not checked.

    Raises:
        RecordingError: a value is implausible; the message names the column, its range in SI (for a time
            column the sampling interval), and the argument to give.
    """
    for group, clock in zip(groups, chosen.clocks.values(), strict=True):
        step = float(np.median(np.diff(group.time))) if group.time.size > FEW else 0.0
        longest = LONGEST_SAID_STEP if clock is not None and clock.unit else LONGEST_STEP
        if clock is not None and not clock.column.stamp and "time" not in units and step > longest:
            raise _unlikely(clock, f"as seconds they are {step:.4g} s apart", "ms or us", "s")
        for variable in chosen.variables:
            limit, likely = UNLIKELY.get(variable.conversion.unit, (np.inf, ""))
            values = group.values.get(variable.name)
            if values is None or not values.size or variable.name in units:
                continue
            real = values[np.isfinite(values)]
            span = float(real.max() - real.min()) if real.size else 0.0
            if span > limit:
                unit = variable.conversion.unit
                raise _unlikely(variable, f"as {unit} they go over {span:.4g} {unit}", likely, unit)


def _unlikely(variable: FileVariable, size: str, likely: str, unit: str) -> RecordingError:
    said = f"units={{{variable.name!r}: ...}}"
    who = "no unit is said with the numbers"
    if variable.unit:
        who = f"the file says {variable.unit}" if variable.sure else "only the end of the name says a unit"
    so = variable.unit or unit
    return RecordingError(
        f"{variable.label}: {who}, and {size}. Say {said}, {likely} perhaps, or {so!r} if it is so"
    )


def warn_of_unread(path: Path, channels: Sequence[FileChannel]) -> None:
    """Warn (RecordingWarning) of columns of a file (its `path` and `channels`) that are left out although
    they seem to contain numbers."""
    left_out = [no_numbers(one) for one in channels if one.unread]
    if left_out:
        warnings.warn(f"{path.name}: left out: {'; '.join(left_out)}", RecordingWarning, stacklevel=3)


def warn_of_unsaid(path: Path, chosen: Selection, groups: Sequence[Clocked]) -> None:
    """Warn (RecordingWarning) of unknown units, and of units that are assumed because neither file nor user
    states them: one warning for all columns of each kind.

    The second warning also names likelier units, and omits columns whose first samples are all missing.

    Args:
        path: file that was read; its name is part of the warnings.
        chosen: selected channels.
        groups: their values in SI, grouped by clock, in the order of `chosen.clocks`.
    """
    unsaid: dict[str, tuple[FileVariable, str]] = {}
    for group, clock in zip(groups, chosen.clocks.values(), strict=True):
        named = [] if clock is None else [(clock, group.time)]
        named += [(one, group.values[one.name]) for one in chosen.variables if one.name in group.values]
        for one, values in named:
            # Plain numbers and dates need no unit.
            known = one.unit or not _si(one) or one.column.stamp
            looked = values[:LOOKED_AT][np.isfinite(values[:LOOKED_AT])]
            if not known and looked.size:
                unsaid.setdefault(one.name, (one, likely_unit(one.name, looked)))
    unknown = [one for one in chosen.variables if one.unknown]
    if unknown:
        taken = ", ".join(f"{one.unit!r} of {one.name} (column {one.column.shown!r})" for one in unknown)
        known = f"{path.name}: units that are not known: {taken}. Plain numbers are taken; say units={{...}}"
        warnings.warn(known, RecordingWarning, stacklevel=3)
    if not unsaid:
        return
    taken = ", ".join(f"{one.label} is taken to be in {_si(one)}" for one, _ in unsaid.values())
    guesses = [f"{guess} for {name}" for name, (one, guess) in unsaid.items() if guess != _si(one)]
    hint = f"; stickslip inspect would guess {', '.join(guesses)}" if guesses else ""
    say = ", ".join(f"{name!r}: {_si(one)!r}" for name, (one, _) in unsaid.items())
    said = f"{path.name}: no unit is said, and {taken}{hint}. Say units={{{say}}}, or what they are"
    warnings.warn(said, RecordingWarning, stacklevel=3)


def _si(variable: FileVariable) -> str:
    return variable.conversion.unit
