import numpy as np

from stickslip.report.figures.frequency import Response, frequency_response

F = np.geomspace(10.0, 2000.0, 200)
S = 2j * np.pi * F
W = 2 * np.pi * 525.0
STAGE = 1.057e-7 * W**2 / (S**2 + 2 * 0.05 * W * S + W**2)


def test_gain_phase_residual_and_coherence() -> None:
    measured = Response(F, STAGE * 1.01, 1e-9 * np.ones_like(F), np.full(F.size, 0.97))
    figure = frequency_response({"30 V": measured}, {"30 V": Response(F, STAGE)}, unit="m/V")
    gain, phase, residual, coherence = figure.axes
    assert [a.get_ylabel() for a in figure.axes] == [
        "gain (µm/V)",
        "phase (°)",
        "|residual| (nm/V)",
        "coherence",
    ]
    assert coherence.get_xlabel() == "frequency (Hz)"
    assert (gain.get_xscale(), gain.get_yscale(), phase.get_yscale()) == ("log", "log", "linear")
    dots, line = gain.lines
    assert (dots.get_label(), line.get_label()) == ("30 V, measured", "30 V, model")
    assert dots.get_color() == line.get_color()
    np.testing.assert_allclose(dots.get_ydata(), np.abs(STAGE) * 1.01e6)
    np.testing.assert_allclose(line.get_ydata(), np.abs(STAGE) * 1e6)
    np.testing.assert_allclose(residual.lines[0].get_ydata(), np.abs(STAGE) * 0.01e9)
    np.testing.assert_allclose(coherence.lines[0].get_ydata(), 0.97)


def test_phase_has_no_jumps() -> None:
    delayed = STAGE * np.exp(-S * 1e-3)
    figure = frequency_response({"mirror": Response(F, delayed)}, unit="m/V")
    expected = np.degrees(-2 * np.pi * F * 1e-3) - np.degrees(
        np.arctan2(2 * 0.05 * F / 525, 1 - (F / 525) ** 2)
    )
    np.testing.assert_allclose(figure.axes[1].lines[0].get_ydata(), expected, atol=1e-6)
    assert len(figure.axes) == 2


def test_band_is_two_deviations_and_stays_positive() -> None:
    deviation = np.where(F < 100, 1e-9, 1e-6)
    figure = frequency_response({"30 V": Response(F, STAGE, deviation)}, unit="m/V")
    (band,) = figure.axes[0].collections
    edges = band.get_paths()[0].vertices
    assert edges[:, 1].min() > 0
    at = edges[np.isclose(edges[:, 0], F[0])][:, 1]
    np.testing.assert_allclose(
        [at.min(), at.max()], [(np.abs(STAGE[0]) - 2e-9) * 1e6, (np.abs(STAGE[0]) + 2e-9) * 1e6]
    )


def test_residual_only_where_the_model_covers_the_data() -> None:
    short = Response(F[:50], STAGE[:50])
    figure = frequency_response({"30 V": Response(F, STAGE)}, {"30 V": short, "handbook": short}, unit="m/V")
    assert [a.get_ylabel() for a in figure.axes] == ["gain (µm/V)", "phase (°)"]
    assert [line.get_label() for line in figure.axes[0].lines] == [
        "30 V, measured",
        "30 V, model",
        "handbook",
    ]
