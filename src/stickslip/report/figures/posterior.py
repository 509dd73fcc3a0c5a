"""Figure of a posterior distribution: single parameters and pairs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import scipy
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from .scale import scale_for
from .style import BLUE, VERMILLION, drawn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Number of bars of a histogram, and of cells along each axis in which the samples of a pair are counted.
BINS = 36
INSIDE = (0.9, 0.5)  # fractions of the samples that the contours of a pair contain


@drawn
def posterior_corner(
    samples: Mapping[str, ArrayLike], units: Mapping[str, str], marks: Mapping[str, float] | None = None
) -> Figure:
    """Draw histograms on the diagonal, and below it contours that contain 50 and 90 % of the samples.

    Args:
        samples: samples of each parameter by name, SI, arrays of one shape.
        units: SI unit of each parameter by name.
        marks: values to mark by dashed lines, such as an estimate, by name of the parameter, SI.
    """
    names = list(samples)
    scales = {n: scale_for(units[n], np.median(np.asarray(samples[n]))) for n in names}
    shown = {n: scales[n](np.asarray(samples[n], dtype=float).ravel()) for n in names}
    count = len(names)
    figure = Figure(figsize=(2.1 * count + 0.4, 1.9 * count + 0.3))
    grid = figure.subplots(count, count, squeeze=False, sharex="col")
    for i, name in enumerate(names):
        for j, other in enumerate(names):
            panel = grid[i, j]
            if j > i:
                panel.remove()
                continue
            if i == j:
                panel.hist(
                    shown[name], bins=BINS, histtype="stepfilled", color=BLUE, alpha=0.35, density=True
                )
                panel.set_yticks([])
                panel.spines["left"].set_visible(False)
            else:
                _contours(panel, shown[other], shown[name])
            if marks and other in marks:
                panel.axvline(float(scales[other](marks[other])), color=VERMILLION, lw=0.9, ls=(0, (4, 2)))
            if marks and i != j and name in marks:
                panel.axhline(float(scales[name](marks[name])), color=VERMILLION, lw=0.9, ls=(0, (4, 2)))
            panel.locator_params(nbins=4)
            panel.grid(visible=False)
            if j == 0 and i > 0:
                panel.set_ylabel(scales[name].label(name))
            elif i != j:
                panel.tick_params(labelleft=False)
            if i == count - 1:
                panel.set_xlabel(scales[other].label(other))
    figure.align_ylabels(grid[1:, 0])
    return figure


def _contours(panel: Axes, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
    density, edges_x, edges_y = np.histogram2d(x, y, bins=BINS)
    density = scipy.ndimage.gaussian_filter(density, 1.2)
    ordered = np.sort(density.ravel())[::-1]
    share = np.cumsum(ordered) / ordered.sum()
    levels = [float(ordered[np.searchsorted(share, inside)]) for inside in INSIDE]
    middle_x, middle_y = 0.5 * (edges_x[1:] + edges_x[:-1]), 0.5 * (edges_y[1:] + edges_y[:-1])
    panel.contourf(
        middle_x, middle_y, density.T, levels=[*levels, float(density.max()) + 1.0], colors=[BLUE], alpha=0.25
    )
    panel.contour(middle_x, middle_y, density.T, levels=levels, colors=[BLUE], linewidths=0.9)
