"""Catalogue of everything that has a name: laws, parameter sets, waveforms, benches, published data, ..."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from ..design.data_sheet import available_data_sheets, load_data_sheet
from ..parameters import available_sets, load_set
from ..physics.contact.catalogue import available_materials, available_pairs, title_of
from ..physics.electronics import available_parts, load_part
from ..quantities import registry
from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError
from ..recording.calibration import load_calibration
from ..recording.calibration.storage import available_calibrations
from ..recording.datasets import DATASETS
from ..recording.readers.formats import TEXT, TEXT_LINE
from ..rig.bench import available_benches, load_bench

KINDS: Mapping[str, Callable[[], dict[str, str]]] = {
    "laws": lambda: _lines(registry.laws),
    "actuators": lambda: {name: load_set(name).title for name in available_sets()},
    "piezo models": lambda: _lines(registry.piezos),
    "waveforms": lambda: _lines(registry.waveforms),
    "sensors": lambda: _lines(registry.sensors),
    "readers": lambda: {TEXT: TEXT_LINE, **_lines(registry.readers)},
    "rigs": lambda: _lines(registry.rigs),
    "amplifiers": lambda: {name: load_part(name).title for name in available_parts("amplifier")},
    "stacks": lambda: {name: load_part(name).title for name in available_parts("stack")},
    "materials": lambda: {name: title_of(name, "material") for name in available_materials()},
    "friction pairs": lambda: {name: title_of(name, "friction pair") for name in available_pairs()},
    "data sheets": lambda: {name: load_data_sheet(name).sheet.title for name in available_data_sheets()},
    "benches": lambda: {name: load_bench(name).title for name in available_benches()},
    "calibrations": lambda: {name: load_calibration(name).source for name in available_calibrations()},
    "datasets": lambda: {name: f"{one.credit} ({one.licence})" for name, one in DATASETS.items()},
}


def catalogue(*kinds: str) -> dict[str, dict[str, str]]:
    """Return all known names by kind, each with a one-line description: {kind: {name: description}}.

    Args:
        kinds: kinds to list: "laws", "actuators" (parameter sets), "piezo models", "waveforms", "sensors",
            "readers", "rigs", "amplifiers", "stacks", "materials", "friction pairs", "data sheets",
            "benches", "calibrations", "datasets"; all of them by default.

    Raises:
        QuantityError: there is no such kind.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise QuantityError(
                f"there is no kind {kind!r}{did_you_mean(kind, KINDS)}; there are {', '.join(KINDS)}"
            )
    return {kind: KINDS[kind]() for kind in kinds or KINDS}


def _lines(kind: registry.Kind) -> dict[str, str]:
    return {name: _line(kind, name) for name in kind.names()}


def _line(kind: registry.Kind, name: str) -> str:
    try:
        found = kind.find(name)
    except registry.RegistryError as error:  # the name is known, but its file fails to load
        return str(error)
    found = getattr(found, "read", found)  # a file format is described by its function `read`
    said, place = _first_sentence(found.__doc__ or ""), registry.origin(found)
    said = "" if said.startswith(f"{name}(") else said
    return f"{said} ({place})".strip() if place else said


def _first_sentence(docstring: str) -> str:
    """Return the first sentence of a docstring as one line. A full stop ends it only before a capital letter
    or at the end of the paragraph, because "fig. 3.7" and "e.g." have one too."""
    paragraph = " ".join(docstring.strip().partition("\n\n")[0].split())
    return re.split(r"(?<=\.) (?=[`A-Z])", paragraph, maxsplit=1)[0]
