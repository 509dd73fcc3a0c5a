import numpy as np
import pytest
from matplotlib.colors import to_rgb

from stickslip.report.figures.identification import (
    Estimates,
    fit_with_residuals,
    friction_loop,
    law_ranking,
    parameter_intervals,
)

TIME = np.linspace(60.0, 200.0, 201)
FORCE = 2.0 * np.sign(np.sin(TIME))
MODEL = FORCE + 0.01 * np.cos(TIME)


def test_fit_shows_data_under_model_and_their_difference() -> None:
    figure = fit_with_residuals(TIME, FORCE, MODEL, name="friction force", unit="N", fitted=[(60.0, 100.0)])
    above, below = figure.axes
    measured, model = above.lines
    np.testing.assert_allclose(measured.get_ydata(), FORCE)
    np.testing.assert_allclose(model.get_ydata(), MODEL)
    assert measured.get_zorder() <= model.get_zorder()
    assert measured.get_linewidth() > 2 * model.get_linewidth()
    assert (above.get_ylabel(), below.get_ylabel()) == ("friction force (N)", "residual (mN)")
    assert below.get_xlabel() == "time (s)"
    np.testing.assert_allclose(below.lines[-1].get_ydata(), 10.0 * np.cos(TIME), atol=1e-9)
    (span,) = above.patches
    assert span.get_extents().transformed(above.transData.inverted()).x1 == pytest.approx(100.0)
    legend = above.get_legend()
    assert legend is not None
    assert [t.get_text() for t in legend.get_texts()] == ["measured", "model", "used for the fit"]


def test_several_models_differ_by_colour_and_dash() -> None:
    figure = fit_with_residuals(
        TIME, FORCE, {"LuGre": MODEL, "Dahl": 0.9 * MODEL}, name="friction force", unit="N"
    )
    _, lugre, dahl = figure.axes[0].lines
    assert (lugre.get_label(), dahl.get_label()) == ("LuGre", "Dahl")
    assert lugre.get_color() != dahl.get_color()
    assert lugre.get_linestyle() != dahl.get_linestyle()
    assert len(figure.axes[1].lines) == 3  # zero, and a residual each


def test_friction_loop() -> None:
    position = 120e-6 * np.sin(TIME)
    figure = friction_loop(position, FORCE, {"LuGre": MODEL})
    above, below = figure.axes
    assert below.get_xlabel() == "position (µm)"
    np.testing.assert_allclose(above.lines[1].get_xdata(), position * 1e6)
    np.testing.assert_allclose(above.lines[1].get_ydata(), MODEL)
    np.testing.assert_allclose(below.lines[-1].get_ydata(), (MODEL - FORCE) * 1e3, atol=1e-9)


def test_intervals_over_a_setting() -> None:
    figure = parameter_intervals(
        [1.0, 3.0, 6.0],
        {
            "gain": Estimates(
                [1e-7, 1.1e-7, 1.2e-7], [0.9e-7, 1.0e-7, 1.1e-7], [1.2e-7, 1.2e-7, 1.3e-7], "m/V"
            ),
            "resonance": Estimates([525.0, 515.0, 490.0], [520, -np.inf, 480], [530, np.nan, 500], "Hz"),
            "damping ratio": Estimates([0.1, 0.2, 0.3], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3]),
        },
        setting_name="drive amplitude",
        setting_unit="V",
    )
    gain, resonance, damping = figure.axes
    assert gain.get_ylabel() == "gain (nm/V)"
    assert resonance.get_ylabel() == "resonance (Hz)"
    assert damping.get_ylabel() == "damping ratio"
    assert {axes.get_xlabel() for axes in figure.axes} == {"drive amplitude (V)"}
    bars = gain.containers[0].lines[2][0].get_segments()
    np.testing.assert_allclose([bar[:, 1] for bar in bars], [[90, 120], [100, 120], [110, 130]])
    bars = resonance.containers[0].lines[2][0].get_segments()
    np.testing.assert_allclose([bar[:, 0] for bar in bars], [[1, 1], [6, 6]])  # the open one has no bar
    hollow = [line for line in resonance.lines if to_rgb(line.get_markerfacecolor()) == (1.0, 1.0, 1.0)]
    assert [line.get_xydata().tolist() for line in hollow] == [[[3.0, 515.0]]]


def test_ranking_is_by_prediction_with_the_best_on_top() -> None:
    figure = law_ranking(
        ["Dahl", "LuGre", "Coulomb"],
        [0.99, 0.999, 0.96],
        [0.98, 0.995, 0.95],
        [300.0, 100.0, 900.0],
        {"prior work": 0.9864},
    )
    ranking, criterion = figure.axes
    assert [tick.get_text() for tick in ranking.get_yticklabels()] == ["Coulomb", "Dahl", "LuGre"]
    lines = {line.get_label(): line for line in ranking.lines}
    np.testing.assert_allclose(lines["predicted part"].get_xdata(), [0.05, 0.02, 0.005])
    np.testing.assert_allclose(lines["fitted part"].get_xdata(), [0.04, 0.01, 0.001])
    np.testing.assert_allclose(lines["prior work"].get_xdata(), 0.0136)
    assert ranking.get_xscale() == "log"
    assert [bar.get_width() for bar in criterion.patches] == [800.0, 200.0, 0.0]
