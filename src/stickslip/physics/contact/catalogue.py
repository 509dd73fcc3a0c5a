"""Materials and friction pairs by name, each number with its source or marked as assumed.

Their TOML files have ``title`` and ``citations``. The file of a material also has ``kind = "material"`` and
the tables of `Material`. The file of a pair has ``kind = "friction pair"``, ``first`` and ``second`` (names
of materials, or paths relative to this file, ending in ``.toml``), and the tables friction_coefficient and
friction_factor (see `stickslip.parameters.load`).
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ...gate.errors import damaged
from ...parameters import ParameterSetError, SetEntry, build, named_file, read_entries, read_toml
from ...quantities.records import Quantity, record
from .material import Bodies, Material
from .mindlin import Coefficient

_MATERIALS, _PAIRS = Path(__file__).parent / "materials", Path(__file__).parent / "pairs"


@record
class Sliding(NamedTuple):
    """Friction coefficient of a pair, and its uncertainty: 68 % of measured values lie between the
    coefficient divided by the `friction_factor` and the coefficient multiplied by this factor."""

    friction_coefficient: Coefficient
    friction_factor: Annotated[float, Quantity("", "×/÷", "factor within which 68 % lie", above=1)]


@dataclass(frozen=True)
class FrictionPair:
    """Two materials that slide on each other, with the sources of their numbers.

    `name` is the name or path that was loaded, `bodies` are both materials, `friction` their friction
    coefficient, and `citations` keys of the bibliography for pair and materials. `assumptions` are the
    numbers that no source prints, by field ("first.hardness"): a text with value and reason.
    """

    name: str
    title: str
    citations: tuple[str, ...]
    bodies: Bodies
    friction: Sliding
    assumptions: dict[str, str]


def available_materials() -> tuple[str, ...]:
    """Return the names of the materials that come with the package."""
    return tuple(sorted(file.stem for file in _MATERIALS.glob("*.toml")))


def available_pairs() -> tuple[str, ...]:
    """Return the names of the friction pairs that come with the package."""
    return tuple(sorted(file.stem for file in _PAIRS.glob("*.toml")))


def title_of(name: str, kind: str) -> str:
    """Return the title of a material or friction pair of the package; `kind` is "material" or "friction
    pair"."""
    folder = _MATERIALS if kind == "material" else _PAIRS
    return str(read_toml(folder / f"{name}.toml")["title"])


def load_material(name: str | os.PathLike[str]) -> Material:
    """Return the material with a name, ``load_material("sapphire")``, or from a TOML file.

    Raises:
        ParameterSetError: there is no such material, or the file is wrong; the message names file and field.
    """
    file = named_file(name, _MATERIALS, "material")
    with damaged(ParameterSetError, str(file)):
        return _material(file)[0]


def load_pair(name: str | os.PathLike[str]) -> FrictionPair:
    """Return the friction pair with a name, ``load_pair("sapphire-steel")``, or from a TOML file.

    Raises:
        ParameterSetError: there is no such pair, or the file or a material is wrong; the message names file
            and field.
    """
    file = named_file(name, _PAIRS, "friction pair")
    with damaged(ParameterSetError, str(file)):
        return _pair(os.fspath(name), file)


def _pair(name: str, file: Path) -> FrictionPair:
    head, content = _head(file, "friction pair")
    assumed, bodies, cited = {}, [], list(head["citations"])
    for side in ("first", "second"):
        said = content.pop(side, None)
        if not isinstance(said, str):
            raise ParameterSetError(f"{file}: {side} = {said!r} must be the name of a material, or a file")
        own = file.parent / said if said.endswith(".toml") else said
        try:
            made, entries, sources = _material(named_file(own, _MATERIALS, "material"))
        except ParameterSetError as error:
            raise ParameterSetError(f"{file}: {side}: {error}") from error
        bodies.append(made)
        cited += sources
        assumed |= {f"{side}.{field}": why for field, why in _assumed(entries).items()}
    entries = read_entries(file, "", content)
    friction = build(Sliding, entries, str(file))
    return FrictionPair(
        name,
        head["title"],
        tuple(dict.fromkeys(map(str, cited))),
        Bodies(*bodies),
        friction,
        assumed | _assumed(entries),
    )


def _material(file: Path) -> tuple[Material, dict[str, SetEntry], list[str]]:
    head, content = _head(file, "material")
    entries = read_entries(file, "", content)
    return build(Material, entries, str(file)), entries, head["citations"]


def _head(file: Path, kind: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read a TOML file; return two mappings of its entries: "title", "citations" and "kind"; and all others.

    Raises:
        ParameterSetError: the file cannot be read, one of the three entries is missing, or its kind is not
            `kind`.
    """
    content = read_toml(file)
    head = {}
    for key, wanted in {"title": str, "citations": list, "kind": str}.items():
        head[key] = content.pop(key, None)
        if not isinstance(head[key], wanted):
            raise ParameterSetError(f"{file}: {key} = {head[key]!r} must be a {wanted.__name__}")
    if head["kind"] != kind:
        raise ParameterSetError(f"{file} is of kind {head['kind']!r}, not {kind!r}")
    return head, content


def _assumed(entries: dict[str, SetEntry]) -> dict[str, str]:
    return {
        field: f"{entry.value} {entry.unit}".rstrip() + f": {entry.reason}"
        for field, entry in entries.items()
        if entry.assumed
    }
