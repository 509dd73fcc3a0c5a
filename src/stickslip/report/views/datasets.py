"""Views of xarray Datasets: step maps, recordings, trajectories, frequency responses, ensembles."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from ..document import Column, Document, Number, Picture, Section, Table
from ..figures.design import is_map
from ..figures.plotting import plot
from ..figures.style import svg
from ..viewing import document_of
from .step_map import map_document

_TITLES = {"time": "Recording", "frequency": "Frequency response", "member": "Members of an ensemble"}


@document_of.register
def dataset_document(data: xr.Dataset) -> Document:
    """Return a document with the figure of `plot`, and least and largest value of each variable.

    A step map has the document of `map_document`. Raises QuantityError for a dataset that cannot be drawn.
    """
    if is_map(data):
        return map_document(data)
    axes = plot(data)  # raises QuantityError for a dataset that cannot be drawn
    over = next(name for name in _TITLES if name in data.dims)
    coordinate = data[over]
    title = str(data.attrs.get("title") or _TITLES[over])
    numbers = {str(name): _range(one) for name, one in data.data_vars.items() if _is_real(one)}
    said = f"{data.sizes[over]} values over {over}"
    if _is_real(coordinate) and coordinate.attrs.get("units"):
        ends = [Number(float(value), str(coordinate.attrs["units"])) for value in coordinate.values[[0, -1]]]
        numbers[over] = {"first": ends[0], "last": ends[1]}
    picture = Picture("data", f"{title}.", svg(axes.flat[0].figure), f"{title}: every variable over {over}")
    return Document(
        title=title,
        summary=f"{said}: {', '.join(map(str, data.data_vars))}.",
        sections=(Section(title, tables=(_ranges(data),), figures=(picture,)),),
        numbers=numbers,
    )


def _is_real(one: xr.DataArray) -> bool:
    return one.dtype.kind in "fiu" and one.size > 0


def _range(one: xr.DataArray) -> dict[str, Any]:
    unit = str(one.attrs.get("units", ""))
    return {"least": Number(float(np.nanmin(one)), unit), "largest": Number(float(np.nanmax(one)), unit)}


def _ranges(data: xr.Dataset) -> Table:
    rows = [
        (str(one.attrs.get("long_name", name)), *_range(one).values())
        for name, one in data.data_vars.items()
        if _is_real(one)
    ]
    return Table("Range of each variable.", (Column("variable"), Column("least"), Column("largest")), rows)
