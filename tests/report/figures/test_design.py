"""Pictures of maps: what is drawn where, and what has no value."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

import stickslip as ss
from stickslip import design
from stickslip.quantities.units import QuantityError
from stickslip.report.figures.design import draw_map

KANG = ss.load_actuator("kang2007")
VOLTS, HERTZ = np.linspace(40.0, 160.0, 7), np.geomspace(10.0, 1000.0, 5)


def test_a_map_over_two() -> None:
    found = ss.step_map(KANG, voltage=VOLTS, frequency=HERTZ)
    (axes,) = ss.plot(found)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("voltage (V)", "frequency (Hz)")
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    cells = axes.collections[0].get_array()
    assert cells.shape == (5, 7)
    at = float(found.net_step.sel(voltage=100.0, frequency=10.0))
    assert 1e-6 * cells[0, 3] == pytest.approx(at, rel=1e-9)
    assert np.all(np.ma.getmaskarray(cells)[:, 6] | ~np.isfinite(np.ma.getdata(cells)[:, 6]))
    assert axes.patch.get_hatch()
    assert [t.get_text() for t in axes.get_legend().get_texts()] == ["no steady step"]


def test_a_panel_for_each_of_the_others_in_the_same_colours() -> None:
    found = ss.step_map(KANG, voltage=VOLTS, frequency=HERTZ, load=[-0.2, 0.0])
    axes = draw_map(found, "speed")
    assert [one.get_title(loc="left") for one in axes] == ["load -200 mN", "load 0 N"]
    limits = [one.collections[0].get_clim() for one in axes]
    assert limits[0] == limits[1]
    assert limits[0][0] == pytest.approx(-limits[0][1])  # it walks both ways, so zero is white
    mine = Figure().subplots(1, 2)
    assert draw_map(found, "speed", mine)[1] is mine[1]
    with pytest.raises(QuantityError, match="3 axes are given, and 2 panels need 2"):
        draw_map(found, "speed", Figure().subplots(1, 3))
    with pytest.raises(QuantityError, match="the map has no 'heat'"):
        draw_map(found, "heat")


def test_lines_with_their_band() -> None:
    found = ss.step_map(KANG, voltage=VOLTS, frequency=100.0, direction=[1, -1])
    (axes,) = ss.plot(found)
    labels = axes.get_legend_handles_labels()[1]
    assert labels == ["forward", "mirrored", "no steady step"]
    np.testing.assert_allclose(axes.lines[1].get_ydata(), 1e6 * found.net_step.sel(direction=-1), rtol=1e-12)
    one = found.sel(direction=1)
    banded = one.assign(net_step_low=0.9 * one.net_step, net_step_high=1.1 * one.net_step)
    (axes,) = ss.plot(banded)
    band = axes.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(1.1e6 * float(one.net_step.max()))
    assert axes.collections[0].get_facecolor()[0][:3] == pytest.approx(to_rgba(axes.lines[0].get_color())[:3])


def test_speed_and_power_over_load() -> None:
    curve = design.load_speed_curve(KANG, ss.Sawtooth(65.0, 5.0), np.linspace(-0.3, 0.0, 7))
    above, below = ss.plot(curve)
    assert above.get_ylabel() == "mean speed (µm/s)"
    assert below.get_ylabel().startswith("mechanical power (")
    assert below.get_xlabel() == "load (mN)"
    np.testing.assert_allclose(above.lines[0].get_ydata(), 1e6 * curve.speed, rtol=1e-12)


def test_what_is_too_much_for_a_picture() -> None:
    found = ss.step_map(
        KANG,
        voltage=VOLTS[:3],
        frequency=HERTZ[:3],
        load=np.linspace(-0.1, 0.0, 3),
        parameters={"rise_fraction": [0.9, 0.95, 0.99, 1.0], "end_effector_mass": [0.05, 0.1, 0.15]},
    )
    with pytest.raises(QuantityError, match=r"too many: choose with map\.sel"):
        ss.plot(found)
    one = ss.step_map(KANG, voltage=65.0, frequency=50.0)
    with pytest.raises(QuantityError, match="over a dimension"):
        ss.plot(one)
