"""Data for pictures of a study: a statistic of one result in cells of two varied values.

Each cell combines all members in it, whatever their other varied values are. Only as many tasks are read as a
picture needs, and damaged tasks are left out; so a large or damaged store can be shown while it grows.
"""

from __future__ import annotations

import math
import os
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from ..gate.errors import damaged
from ..quantities.units import QuantityError
from .chunks import ChunkError
from .errors import StudyError
from .layout import StudyVariable
from .store import Store

Array = NDArray[np.float64]
Statistic = Literal["median", "tenth", "nine_tenths", "least", "greatest", "count", "failed"]

# Number of cells along an axis; an axis of a grid with up to twice as many values has a cell for each value.
CELLS = 32
# Largest number of members that are read for a picture; of a larger study, evenly spaced tasks are read.
MOST = 2**20
WIDE = 5.0  # ratio of the greatest to the least value above which positive values have logarithmic cells
_QUANTILES = {"median": 0.5, "tenth": 0.1, "nine_tenths": 0.9, "least": 0.0, "greatest": 1.0}


class StudyPicture(NamedTuple):
    """Picture of a study: the statistic of a result in cells of two varied values.

    `across` and `up` are the edges of the cells along the horizontal and vertical axis, in SI. `cells`
    [up, across] contains the statistic, NaN in empty cells. `log` is a pair for the axes (across, up): True
    for a logarithmic axis. `members` is the number of members shown, `done` the number of finished tasks,
    `read` the number of tasks selected for reading, and `damaged` the number of these that are damaged.
    """

    across: Array
    up: Array
    cells: Array
    log: tuple[bool, bool]
    members: int
    done: int
    read: int
    damaged: int


def pictured(store: Store) -> tuple[dict[str, StudyVariable], dict[str, StudyVariable]]:
    """Return the variables that a picture of a study can show: varied values and results, two dicts by name.

    Shown results have one number per member; texts, the status and trajectories are left out.

    Raises:
        StudyError: the description or coordinates of the store are damaged.
    """
    layout, at_random = store.layout, _at_random(store)
    varied = {name: one for name, (one, _) in _coordinates(store).items()}
    results = {}
    for one in layout.variables:
        if one.name in at_random:
            varied[one.name] = one
        elif one.dtype == "float64" and one.dims == layout.dims and not one.inner:
            results[one.name] = one
    return varied, results


def study_picture(
    path: str | os.PathLike[str], result: str, across: str, up: str = "", statistic: Statistic = "median"
) -> StudyPicture:
    """Return a statistic of one result over one or two varied values, in cells.

    Args:
        path: folder of the study.
        result: name of the result.
        across, up: names of the varied values on the two axes; without `up` the result itself is the vertical
            axis, and cells count members, whatever the statistic is.
        statistic: "median", "tenth" or "nine_tenths" (quantiles 0.5, 0.1 and 0.9), "least", "greatest",
            "count" of members, or "failed", the fraction of computed members whose status is not 0
            (complete). All but "failed" count complete members with a finite result alone.

    Raises:
        QuantityError: there is no such name or statistic.
        StudyError: the folder is no store of a study, is damaged, or contains nothing that can be shown yet.
    """
    store = Store(path)
    varied, results = pictured(store)
    for name, among in ((result, results), (across, varied), (up or across, varied)):
        if name not in among:
            raise QuantityError(f"the study has no {name!r}; there are {', '.join(among)}")
    if statistic not in get_args(Statistic):
        raise QuantityError(f"statistic: there are {', '.join(get_args(Statistic))}, not {statistic!r}")
    known = _coordinates(store)
    names = list(dict.fromkeys([across, up or result, result]))
    columns, done, read, damaged = _columns(store, [*names, "status"], known)
    complete = columns["status"] == 0
    failing = statistic == "failed" and bool(up)
    there = np.full(complete.shape, True) if failing else complete & np.isfinite(columns[result])
    if not there.any():
        raise StudyError(f"{store.path}: there is nothing to show yet")
    values = {name: columns[name][there] for name in names}
    edges = [_edges(values[n], known[n][1] if n in known else None) for n in (across, up or result)]
    cells = [_cell(values[n], e) for n, e in zip((across, up or result), edges, strict=True)]
    shape = (edges[1].size - 1, edges[0].size - 1)
    flat = cells[1] * shape[1] + cells[0]
    shown = np.where(complete[there], 0.0, 1.0) if failing else values[result]
    found = _of_cells(flat, shown, math.prod(shape), statistic if up else "count").reshape(shape)
    log = _log(edges[0]), _log(edges[1])
    return StudyPicture(edges[0], edges[1], found, log, int(there.sum()), done, read, damaged)


def _at_random(store: Store) -> set[str]:
    """Return the names of the quantities of random designs, according to the store's description.

    Raises StudyError if the description is damaged.
    """
    with damaged(StudyError, f"{store.path}: its description is damaged"):
        points = store.description["study"]["points"]
        parts = points if isinstance(points, list) else [points]
        return {name for one in parts for name in one.get("ranges", {})}


def _coordinates(store: Store) -> dict[str, tuple[StudyVariable, Array]]:
    """Return variable and values [n] of each varied quantity of a grid or of draws, by name.

    The values of random designs are not among them; they are stored with each task.
    """
    found = store.coordinates()
    return {
        name: one
        for name, one in found.items()
        if len(one[0].dims) == 1 and {*one[0].dims} <= {*store.layout.dims}
    }


def _columns(
    store: Store, names: list[str], known: dict[str, tuple[StudyVariable, Array]]
) -> tuple[dict[str, Array], int, int, int]:
    """Read values of the members of finished tasks, at most about `MOST` members.

    Args:
        store: store of the study.
        names: names of results and varied quantities to read.
        known: varied quantities of `_coordinates`; all others are read from the tasks.

    Returns:
        Arrays [members] by these names, and the numbers of finished, selected and damaged tasks. Damaged
        tasks are left out.
    """
    layout = store.layout
    of = {one.name: one for one in layout.variables}
    done = np.flatnonzero(store.done())
    most = max(1, MOST // math.prod(layout.task))
    chosen = (
        done[np.unique(np.linspace(0, done.size - 1, min(most, done.size)).astype(int))]
        if done.size
        else done
    )
    columns: dict[str, list[Array]] = {name: [] for name in names}
    damaged = 0
    for number in chosen.tolist():
        place = layout.place(number)
        shape = tuple(part.stop - part.start for part in place.values())
        try:
            found = {}
            for name in names:
                if name in known:
                    dims, values = known[name][0].dims, known[name][1][place[known[name][0].dims[0]]]
                else:
                    dims, values = of[name].dims, store.read(number, of[name])
                spread = values.reshape([n if d in dims else 1 for d, n in zip(place, shape, strict=True)])
                found[name] = np.broadcast_to(spread, shape).ravel()
        except ChunkError:
            damaged += 1
            continue
        for name, values in found.items():
            columns[name].append(values)
    joined = {name: np.concatenate(parts) if parts else np.empty(0) for name, parts in columns.items()}
    return joined, int(done.size), int(chosen.size), damaged


def _edges(values: Array, known: Array | None) -> Array:
    """Return the edges of the cells along an axis, ascending.

    If `known` has 2 to 2 `CELLS` values, there is a cell around each, with edges halfway between the values.
    Otherwise `CELLS` cells of equal width span the values, or a single cell if all values are equal. If the
    values are positive and their ratio exceeds `WIDE`, edges are placed on the logarithmic scale.

    Args:
        values: values of the shown members.
        known: values of the grid or draws along this axis; None for others.
    """
    low, high = float(values.min()), float(values.max())
    log = low > 0.0 and high / low > WIDE
    if known is not None and 1 < known.size <= 2 * CELLS:
        at = np.log(np.sort(known)) if log and known.min() > 0.0 else np.sort(known)
        middle = (at[1:] + at[:-1]) / 2
        edges = np.concatenate([[2 * at[0] - middle[0]], middle, [2 * at[-1] - middle[-1]]])
        return np.exp(edges) if log and known.min() > 0.0 else edges
    if not low < high:
        apart = abs(low) / 2 or 0.5
        return np.array([low - apart, low + apart])
    return np.geomspace(low, high, CELLS + 1) if log else np.linspace(low, high, CELLS + 1)


def _log(edges: Array) -> bool:
    """Return True if the logarithms of the edges are more evenly spaced than the edges.

    Return False for fewer than three edges, or edges that are not all positive.
    """
    if edges.size < 3 or not edges[0] > 0.0:
        return False
    uneven = [np.ptp(apart) / abs(apart.mean()) for apart in (np.diff(edges), np.diff(np.log(edges)))]
    return bool(uneven[1] < uneven[0])


def _cell(values: Array, edges: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, edges.size - 2)


def _of_cells(flat: NDArray[np.intp], values: Array, count: int, statistic: Statistic) -> Array:
    """Return the statistic of the values in each cell, an array [count]; NaN for empty cells.

    A quantile is the value of the nearest rank, without interpolation.

    Args:
        flat: index of the cell of each value.
        values: values of the members; for "failed" 1 for failed members and 0 for others.
        count: number of cells.
        statistic: name of the statistic, see `study_picture`.
    """
    many = np.bincount(flat, minlength=count)
    if statistic == "count":
        return np.where(many > 0, many, np.nan).astype(float)
    found, some = np.full(count, np.nan), many > 0
    if statistic == "failed":
        found[some] = np.bincount(flat, values, minlength=count)[some] / many[some]
        return found
    ordered = values[np.lexsort((values, flat))]
    first = np.cumsum(many) - many
    at = first + np.round(_QUANTILES[statistic] * (many - 1)).astype(int)
    found[some] = ordered[at[some]]
    return found
