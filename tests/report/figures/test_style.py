import io
import xml.etree.ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from stickslip.report.figures.style import (
    DOTS_PER_INCH,
    LONGEST_TEXT,
    MANY_MARKERS,
    MANY_POINTS,
    drawn,
    panels,
    svg,
    trace,
)


def picture(points: int, **how: object) -> Figure:
    figure, (axes,) = panels([2.0])
    x = np.linspace(0.0, 1.0, points)
    trace(axes, x, np.sin(40 * x), **how)
    return figure


def test_settings_of_the_user_are_neither_used_nor_changed() -> None:
    with mpl.rc_context({"font.size": 33.0, "lines.linewidth": 9.0}):
        before = dict(mpl.rcParams)
        inside = drawn(lambda: picture(10))()
        svg(inside)
        assert dict(mpl.rcParams) == before
    axes = inside.axes[0]
    assert axes.lines[0].get_linewidth() < 2.0
    assert axes.xaxis.get_ticklabels()[0].get_fontsize() < 10.0


def test_svg_is_what_savefig_draws() -> None:
    saved, made = io.StringIO(), drawn(lambda: picture(MANY_POINTS + 1))
    as_drawn = {"Date": None, "Creator": None}
    drawn(lambda: made().savefig(saved, format="svg", dpi=DOTS_PER_INCH, metadata=as_drawn))()
    body = saved.getvalue().split("</metadata>")[1].strip()
    assert "data:image/png;base64" in body
    assert svg(made()).endswith(body)


def test_svg_stands_alone_and_is_reproducible() -> None:
    text = svg(picture(100))
    assert text == svg(picture(100))
    root = ET.fromstring(text)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    links = [v for e in root.iter() for k, v in e.attrib.items() if k.endswith("href")]
    assert links
    assert all(link.startswith("#") for link in links)
    assert "<metadata" not in text
    assert not text.startswith("<?xml")


@pytest.mark.parametrize(
    ("points", "how", "pixels"),
    [
        (MANY_POINTS, {}, False),
        (MANY_POINTS + 1, {}, True),
        (MANY_MARKERS, {"marker": "."}, False),
        (MANY_MARKERS + 1, {"marker": "."}, True),
    ],
)
def test_dense_traces_become_pixels(points: int, how: dict[str, str], pixels: bool) -> None:
    figure = picture(points, **how)
    assert bool(figure.axes[0].lines[0].get_rasterized()) is pixels
    assert ("data:image/png;base64" in svg(figure)) is pixels


def test_svg_of_a_dense_trace_is_small() -> None:
    assert len(svg(picture(500_000))) < 300_000


def test_a_text_of_a_file_is_cut_before_it_is_drawn() -> None:
    """A label of 120,000 characters took 8 s of computing."""
    figure = Figure()
    panel = figure.add_subplot()
    panel.plot([0.0, 1.0], label="legend" * 20_000)
    panel.set_ylabel("axis" * 30_000)
    panel.set_title("title" * 20_000, loc="left")
    panel.legend()
    assert len(svg(figure)) < 200_000
    assert len(panel.get_ylabel()) == len(panel.get_title(loc="left")) == LONGEST_TEXT + 4
