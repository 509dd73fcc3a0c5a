"""Amplifiers and piezo stacks by name: their datasheet numbers, from TOML files like parameter sets.

A file has ``title``, ``citations`` and ``kind`` ("amplifier" or "stack"), and a table per number, with its
unit and source, or ``assumed = true`` and a reason (see `stickslip.parameters.load`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...gate.errors import damaged
from ...parameters import ParameterSetError, SetEntry, build, named_file, read_entries, read_toml
from .amplifier import Amplifier
from .stack import Stack

_PARTS = Path(__file__).parent / "sets"
_KINDS: dict[str, Any] = {"amplifier": Amplifier, "stack": Stack}
_TOP = {"title": str, "citations": list, "kind": str}


@dataclass(frozen=True)
class Part:
    """An amplifier or a stack with the sources of its numbers.

    `record` is the `Amplifier` or `Stack`, `kind` "amplifier" or "stack", and `entries` contains value and
    source of each number by field, as written in the file. `citations` are keys of the bibliography.
    """

    name: str
    title: str
    citations: tuple[str, ...]
    kind: str
    record: Any
    entries: dict[str, SetEntry]

    @property
    def assumptions(self) -> dict[str, str]:
        """Return the numbers that no source prints, by field: a text with value, unit and reason."""
        return {
            field: f"{entry.value} {entry.unit}".rstrip() + f": {entry.reason}"
            for field, entry in self.entries.items()
            if entry.assumed
        }


def available_parts(kind: str = "") -> tuple[str, ...]:
    """Return the names of the parts that come with the package, of one kind ("amplifier", "stack") or, by
    default, of both."""
    names = sorted(file.stem for file in _PARTS.glob("*.toml"))
    return tuple(name for name in names if not kind or load_part(name).kind == kind)


def load_part(name: str | os.PathLike[str]) -> Part:
    """Return a part that comes with the package, or from a TOML file, with its sources.

    Raises:
        ParameterSetError: there is no such part, or the file is wrong; the message names file and field.
    """
    file = named_file(name, _PARTS, "part")
    with damaged(ParameterSetError, str(file)):
        return _part(os.fspath(name), file, read_toml(file))


def _part(name: str, file: Path, content: dict[str, Any]) -> Part:
    head = {}
    for key, wanted in _TOP.items():
        head[key] = content.pop(key, None)
        if not isinstance(head[key], wanted):
            raise ParameterSetError(f"{file}: {key} = {head[key]!r} must be a {wanted.__name__}")
    if head["kind"] not in _KINDS:
        raise ParameterSetError(f"{file}: kind = {head['kind']!r} must be one of {', '.join(_KINDS)}")
    entries = read_entries(file, "", content)
    record = build(_KINDS[head["kind"]], entries, str(file))
    return Part(name, head["title"], tuple(map(str, head["citations"])), head["kind"], record, entries)


def load_amplifier(name: str | os.PathLike[str]) -> Amplifier:
    """Return the amplifier with a name, ``load_amplifier("pd200x4")``, or from a TOML file.

    Raises:
        ParameterSetError: as `load_part`; or it is no amplifier.
    """
    return _of_kind(name, "amplifier")


def load_stack(name: str | os.PathLike[str]) -> Stack:
    """Return the stack with a name, ``load_stack("nac2022-h50")``, or from a TOML file.

    Raises:
        ParameterSetError: as `load_part`; or it is no stack.
    """
    return _of_kind(name, "stack")


def _of_kind(name: str | os.PathLike[str], kind: str) -> Any:
    part = load_part(name)
    if part.kind != kind:
        known = ", ".join(available_parts(kind))
        raise ParameterSetError(f"{part.name} is of kind {part.kind!r}, not {kind!r}; there are {known}")
    return part.record
