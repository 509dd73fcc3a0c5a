"""The waveform that a recording's attribute "drive" names."""

from __future__ import annotations

import ast
import math
from typing import Any

import xarray as xr

from ..waveform.sequence import Sequence
from ..waveform.signal import Waveform, shape


def named_drive(recording: xr.Dataset) -> Waveform | None:
    """The waveform from its own begin on; None where the attribute is missing or names none that is known.

    The attribute is the waveform as Python shows it: names of waveforms, numbers and texts are read, nothing
    is run.
    """
    try:
        made = _read(ast.parse(str(recording.attrs.get("drive", "")), mode="eval").body)
    except (SyntaxError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return made if hasattr(made, "drive") else None


def _read(node: ast.expr) -> Any:
    if isinstance(node, ast.Tuple):
        return tuple(_read(one) for one in node.elts)
    if isinstance(node, ast.Name) and node.id == "inf":
        return math.inf
    if not isinstance(node, ast.Call):
        return ast.literal_eval(node)
    name = str(getattr(node.func, "id", ""))
    fields = {str(field.arg): _read(field.value) for field in node.keywords}
    if name == "Sequence":
        return Sequence(*fields["parts"])
    return shape(name)(*map(_read, node.args), **fields)
