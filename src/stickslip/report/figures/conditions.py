"""Figures of a search for a drive: goals in every condition, and fronts of two goals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .scale import scale_for
from .style import BLUE, MEASURED, WIDTH, drawn, legend_above, shown

if TYPE_CHECKING:
    import xarray as xr

# Largest number of conditions for which a figure has their names; with more, rows have no names.
MOST_NAMED = 12


@drawn
def draw_conditions(
    names: Sequence[str], values: Mapping[str, NDArray[Any]], label: str, unit: str, sign: float = 1.0
) -> NDArray[Any]:
    """Draw the values of a goal in each condition, a row for each; the worst of the first series is on top.

    More than `MOST_NAMED` conditions are drawn without names.

    Args:
        names: names of the conditions.
        values: the goal for exactly two drives or actuators, by their names: arrays [conditions] in SI, in
            the order of `names`.
        label, unit: label of the axis, and SI unit of the values.
        sign: +1 if larger values are better, -1 if smaller ones are.

    Returns:
        The axes, shape (1,).
    """
    first = next(iter(values.values()))
    order: list[int] = np.argsort(-sign * first).tolist()
    scale = scale_for(unit, np.concatenate(list(values.values())))
    few = len(names) <= MOST_NAMED
    panel = shown(WIDTH, 1.3 + 0.22 * len(names) if few else 3.0).subplots()
    rows = np.arange(len(names))
    columns = [scale(np.asarray(one)[order]) for one in values.values()]
    if few:
        panel.hlines(rows, columns[0], columns[1], color="#BFBFBF", lw=1.5, zorder=1)
        panel.set_yticks(rows, [names[i] for i in order])
    else:
        panel.set_ylabel("conditions, from the best up to the worst")
        panel.set_yticks([])
    marks = zip(values, columns, ("o", "s"), (BLUE, MEASURED), strict=True)
    for name, column, marker, colour in marks:
        panel.plot(column, rows, marker, color=colour, ms=5 if few else 2.5, label=name)
    panel.set(xlabel=scale.label(label), ylim=(-0.6, len(names) - 0.4))
    panel.margins(x=0.06)
    legend_above(panel)
    return np.array([panel], dtype=object)


@drawn
def draw_front(table: xr.Dataset) -> NDArray[Any]:
    """Draw a Pareto front: the second goal over the first, one point for each drive.

    Args:
        table: `table` of a `design.Front`: both goals over "point".

    Returns:
        The axes, shape (1,).
    """
    first, second = (table[name] for name in table if name != "frequency")
    scales = [scale_for(str(one.attrs["units"]), one.values) for one in (first, second)]
    panel = shown(WIDTH, 3.0).subplots()
    panel.plot(scales[0](first.values), scales[1](second.values), "o-", color=BLUE, ms=4)
    labels = [
        scale.label(str(one.attrs["long_name"])) for scale, one in zip(scales, (first, second), strict=True)
    ]
    panel.set(xlabel=labels[0], ylabel=labels[1])
    return np.array([panel], dtype=object)
