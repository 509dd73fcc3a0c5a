import numpy as np
import pytest

from stickslip.report.figures.scale import scale_for


@pytest.mark.parametrize(
    ("unit", "values", "shown", "factor"),
    [
        ("m", [0.0, 28.8e-6], "µm", 1e6),
        ("m", [-950e-9, 1e-12], "nm", 1e9),
        ("m", [999.99999e-9], "µm", 1e6),  # would read 1000 nm
        ("N", [0.54], "mN", 1e3),
        ("N/m", [1.399e6], "MN/m", 1e-6),
        ("s", [1.6], "s", 1.0),
        ("rad/s", [3303.1], "rad/s", 1.0),
        ("", [1e-6], "", 1.0),
        ("m", [0.0, 0.0], "m", 1.0),
        ("m", [], "m", 1.0),
    ],
)
def test_prefix_of_the_largest(unit: str, values: list[float], shown: str, factor: float) -> None:
    scale = scale_for(unit, values)
    assert (scale.unit, scale.factor) == (shown, pytest.approx(factor, rel=1e-15))


def test_several_arrays_share_the_scale_and_gaps_do_not_count() -> None:
    scale = scale_for("m", [1e-9, np.nan], np.array([[np.inf, 3e-6]]))
    assert scale.unit == "µm"
    np.testing.assert_allclose(scale([2e-6, -5e-7]), [2.0, -0.5])


def test_label() -> None:
    assert scale_for("m", 2e-6).label("position") == "position (µm)"
    assert scale_for("").label("coherence") == "coherence"
