"""Style of all figures: palette, sizes and fonts; panels, traces and legends; and the conversion to SVG."""

from __future__ import annotations

import functools
import io
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.style import context
from numpy.typing import ArrayLike, NDArray

from ...quantities.units import QuantityError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

P = ParamSpec("P")
R = TypeVar("R")

# Okabe and Ito's palette, whose colours people with any colour vision can distinguish. Yellow is left out: it
# cannot be seen on white.
BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, BLACK = "#E69F00", "#56B4E9", "#000000"
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
MEASURED = "#8C8C8C"  # colour of measured data: a broad grey line under the model's thin coloured one
SHADE = "#F0EFEA"  # background colour of a part of the time axis, such as the fitted part
# Line styles: the lines of one axis also differ by dashes, for prints in black and white.
DASHES = ("-", (0, (5, 1.5)), (0, (2, 1)), (0, (6, 1.5, 1.5, 1.5)))

WIDTH = 7.0  # usual width of a figure, that of a page's text, inches
# Number of points of a line, and number of markers, above which a trace is drawn as pixels within the SVG, to
# keep the file small. A marker takes more bytes than a point.
MANY_POINTS, MANY_MARKERS = 5000, 1000
DOTS_PER_INCH = 200  # resolution of traces that are drawn as pixels
# Largest number of characters of a title or label that is drawn; the rest is cut off, because 120,000
# characters, as a file may contain, take 8 s to draw.
LONGEST_TEXT = 500

_STYLE: dict[str, Any] = {
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "axes.edgecolor": "#404040",
    "axes.labelcolor": "#202020",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.prop_cycle": f"cycler(color={SERIES})",
    "axes.axisbelow": True,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.useoffset": False,
    "axes.xmargin": 0.01,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "lines.solid_capstyle": "round",
    "xtick.color": "#404040",
    "ytick.color": "#404040",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "font.family": "DejaVu Sans",  # part of matplotlib, so that every machine has this font
    "font.size": 9,
    "figure.constrained_layout.w_pad": 0.07,
    "figure.constrained_layout.h_pad": 0.06,
    "figure.constrained_layout.use": True,
    "figure.dpi": 100,
    "svg.fonttype": "path",  # letters as outlines, so that they look alike on machines with other fonts
    "svg.hashsalt": "stickslip",  # fixed identifiers in the SVG: equal figures give equal files
}


def drawn(make: Callable[P, R]) -> Callable[P, R]:
    """Decorate a drawing function so that it runs with this package's style, whatever the user's settings."""

    @functools.wraps(make)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        with context(_STYLE, after_reset=True):
            return make(*args, **kwargs)

    return run


def shown(width: float, height: float) -> Figure:
    """Return a new pyplot figure for interactive use; width and height in inches.

    A notebook shows the figure below the cell, ``pyplot.show()`` shows it in a window.
    """
    # Other figures are made without pyplot, which keeps each of its figures in memory.
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width, height), layout="constrained")


def panels_given(axes: Any, count: int, new: Callable[[], Any]) -> NDArray[Any]:
    """Return the axes that a user gave, or, if `axes` is None, those that `new` makes; shape (count,).

    Args:
        axes: Matplotlib axes in an array of any shape, a single one, or None.
        count: required number of axes.
        new: function without arguments that makes a figure with this number of axes.

    Raises:
        QuantityError: there is another number of axes.
    """
    found = np.asarray(new() if axes is None else axes, dtype=object).reshape(-1)
    if found.size != count:
        raise QuantityError(f"{found.size} axes are given, and {count} panels need {count}")
    return found


@drawn
def panels(
    heights: Sequence[float], *, columns: int = 1, width: float = WIDTH, share_x: bool = True
) -> tuple[Figure, list[Axes]]:
    """Return a new figure of panels in rows and columns, and its axes row by row.

    Args:
        heights: height of each row, inches.
        columns: number of columns.
        width: width of the figure, inches.
        share_x: True if the panels of one column share one horizontal axis.
    """
    figure = Figure(figsize=(width, sum(heights)))
    shared = "col" if share_x else False
    grid = figure.subplots(len(heights), columns, sharex=shared, squeeze=False, height_ratios=list(heights))
    axes = list(grid.ravel())
    figure.align_ylabels(axes)
    return figure, axes


def trace(axes: Axes, x: ArrayLike | NDArray, y: ArrayLike | NDArray, **how: Any) -> Line2D:
    """Draw a line through the points (x, y), or markers at the points, and return the line object.

    More than `MANY_POINTS` points, or `MANY_MARKERS` markers, are drawn as pixels. `how` is passed to
    matplotlib.
    """
    (line,) = axes.plot(x, y, **how)
    limit = MANY_POINTS if line.get_marker() == "None" else MANY_MARKERS
    line.set_rasterized(len(line.get_xdata()) > limit)  # type: ignore[arg-type]
    return line


@drawn
def legend_above(axes: Axes, columns: int = 4) -> None:
    """Put the legend in rows of up to `columns` entries above the panel, where it hides no data.

    Nothing is drawn without labelled lines.
    """
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        columns = min(columns, len(labels))
        # Matplotlib fills a legend column by column, but people read it row by row.
        order = [i for first in range(columns) for i in range(first, len(labels), columns)]
        axes.legend(
            [handles[i] for i in order],
            [labels[i] for i in order],
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=columns,
            borderaxespad=0.2,
            handlelength=2.2,
            columnspacing=1.4,
        )


def shade(axes: Iterable[Axes], spans: Iterable[tuple[float, float]], label: str) -> None:
    """Shade spans (start, end) of the horizontal axis in all panels.

    The spans are in the units that the axis shows. The label is for the legend of the first panel.
    """
    for row, panel in enumerate(axes):
        for i, (start, end) in enumerate(spans):
            panel.axvspan(start, end, color=SHADE, lw=0, zorder=0, label=label if row == i == 0 else None)


def _texts(figure: Figure) -> Iterator[Text]:
    """Yield the texts of a figure's axes that may come from a user's file: titles, labels, legends, notes.

    Tick labels, and texts and legends of the whole figure, are not among them.
    """
    for one in figure.axes:
        yield from (one.title, one._left_title, one._right_title)  # type: ignore[attr-defined]
        yield from (one.xaxis.label, one.yaxis.label, *one.texts)
        legend = one.get_legend()
        yield from legend.get_texts() if legend is not None else ()


def svg(figure: Figure) -> str:
    """Return the figure as an SVG element: text without XML header, date or external references.

    The figure is changed: texts of its axes with more than `LONGEST_TEXT` characters are cut off, its
    resolution is `DOTS_PER_INCH`, and a pyplot figure is closed.
    """
    target = io.StringIO()
    figure.dpi = DOTS_PER_INCH
    for text in _texts(figure):
        if len(text.get_text()) > LONGEST_TEXT:
            text.set_text(f"{text.get_text()[:LONGEST_TEXT]} ...")
    with context(_STYLE, after_reset=True):
        # `print_svg` saves time: `savefig` would draw the figure twice, the first time only for the layout.
        FigureCanvasSVG(figure).print_svg(target, metadata={"Date": None, "Creator": None})
    # A notebook would also show a figure below the cell that pyplot has not closed.
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close(figure)
    text = target.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    return text[text.index("<svg") :].strip()
