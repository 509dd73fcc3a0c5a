"""Shell completion of arguments with known names."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from contextlib import suppress

import typer


def _completing(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a completion function for typer, which returns the names that start with a text.

    `names` returns all names. It is called at the completion only, so that other commands do not import what
    it needs.
    """

    def complete(incomplete: str) -> list[str]:
        return [name for name in names() if name.startswith(incomplete)]

    return complete


def _sets() -> Iterable[str]:
    from ..parameters.load import available_sets

    return available_sets()


def _laws() -> Iterable[str]:
    from ..quantities.registry import laws

    return laws.names()


def _waveforms() -> Iterable[str]:
    """Yield the names of waveforms that have fields, as on command lines: "reverse-sawtooth"."""
    from ..quantities.registry import waveforms

    return (
        re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()
        for name, one in waveforms.all()
        if hasattr(one, "_fields")
    )


def _stacks() -> Iterable[str]:
    from ..physics.electronics.parts import available_parts

    return available_parts("stack")


def _data_sheets() -> Iterable[str]:
    from ..design.data_sheet import available_data_sheets

    return available_data_sheets()


def _twins() -> Iterable[str]:
    from ..quantities.registry import twins

    return twins.names()


def _benches() -> Iterable[str]:
    from ..rig.bench import available_benches

    return available_benches()


def _calibrations() -> Iterable[str]:
    from ..recording.calibration.storage import available_calibrations

    return available_calibrations()


def _cited() -> Iterable[str]:
    from ..parameters.citations import references

    return dict.fromkeys((*_sets(), *_laws(), *references()))


def _kinds() -> Iterable[str]:
    from ..jobs.known import KINDS

    return KINDS


def _skeletons() -> Iterable[str]:
    from ..jobs.skeletons import KINDS

    return KINDS


def changes(context: typer.Context, incomplete: str) -> list[str]:
    """Return completions of the option --set ("NAME="): fields of the parameter set, law and waveform that
    are given in the same command line.

    Args:
        context: typer's state of the command line that is being completed.
        incomplete: text that the user has typed so far after --set.
    """
    from .changes import names_to_set

    given = context.params
    # The option --set has no value yet, so typer has not parsed the arguments around it: they are in `args`.
    # The first of them is the parameter set.
    name = (*context.args, given["parameters"])[0]
    # An unknown name of a set, law or waveform gives no completions; the command itself reports it.
    with suppress(ValueError):
        names = names_to_set(name, given["law"], given["waveform"])
        return [f"{name}=" for name in names if name.startswith(incomplete)]
    return []


sets = _completing(_sets)
laws = _completing(_laws)
waveforms = _completing(_waveforms)
stacks = _completing(_stacks)
data_sheets = _completing(_data_sheets)
twins = _completing(_twins)
benches = _completing(_benches)
calibrations = _completing(_calibrations)
cited = _completing(_cited)
kinds = _completing(_kinds)
skeletons = _completing(_skeletons)
