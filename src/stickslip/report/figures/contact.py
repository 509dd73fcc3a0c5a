"""Figures of priors from contact mechanics, and of the posteriors that recordings give."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import ArrayLike

from .scale import scale_for
from .style import BLUE, GREEN, MEASURED, VERMILLION, WIDTH, drawn

BINS = 60  # number of edges of a histogram's bars
# Largest fraction of a distribution's samples beyond an end of the axis; they are not drawn.
TAIL = 0.002
COLOURS = (BLUE, GREEN)

Samples = Mapping[str, ArrayLike]


@drawn
def prior_and_posteriors(
    prior: Samples, cases: Mapping[str, Mapping[str, Samples]], truths: Mapping[str, Samples], units: Samples
) -> Figure:
    """Draw histograms of prior and posterior, in a row for each case and a column for each parameter.

    The axes of the parameters are logarithmic.

    Args:
        prior: samples of each parameter by name, SI; drawn as a grey shade in each panel.
        cases: by title of the case, up to two posteriors by their names ("without", "with"), each with
            samples of each parameter by name, SI.
        truths: by title of the case, the true value of each parameter by name, drawn as a dashed line.
        units: SI unit of each parameter by name.
    """
    names = list(prior)
    figure = Figure(figsize=(WIDTH, 1.0 + 1.6 * len(cases)))
    grid = figure.subplots(len(cases), len(names), squeeze=False, sharex="col")
    for column, name in enumerate(names):
        every = [prior[name], *(of[name] for case in cases.values() for of in case.values())]
        scale = scale_for(str(units[name]), float(np.median(np.asarray(prior[name]))))
        ends = [np.quantile(scale(np.asarray(one, float).ravel()), [TAIL, 1.0 - TAIL]) for one in every]
        edges = np.geomspace(min(low for low, _ in ends), max(high for _, high in ends), BINS)
        for row, (title, case) in enumerate(cases.items()):
            panel = grid[row, column]
            shade = np.asarray(prior[name], float).ravel()
            panel.hist(scale(shade), edges, weights=_even(shade), color=MEASURED, alpha=0.35, label="prior")
            for colour, (label, of) in zip(COLOURS, case.items(), strict=False):
                drawn_of = np.asarray(of[name], float).ravel()
                panel.hist(
                    scale(drawn_of),
                    edges,
                    weights=_even(drawn_of),
                    histtype="step",
                    color=colour,
                    label=label,
                )
            panel.axvline(float(scale(truths[title][name])), color=VERMILLION, lw=1.0, ls=(0, (4, 2)))
            panel.set_xscale("log")
            panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            panel.xaxis.set_major_formatter("{x:g}")
            panel.xaxis.set_minor_locator(NullLocator())
            panel.set_yticks([])
            panel.grid(visible=False)
            panel.spines["left"].set_visible(False)
            if column == 0:
                panel.set_title(title, loc="left")
            if row == len(cases) - 1:
                panel.set_xlabel(scale.label(name))
    grid[0, -1].legend(loc="upper right", fontsize=8)
    return figure


def _even(samples: np.ndarray) -> np.ndarray:
    """Return equal weights with sum 1, so that the bars of a histogram show shares of all samples."""
    return np.full(samples.size, 1.0 / samples.size)
