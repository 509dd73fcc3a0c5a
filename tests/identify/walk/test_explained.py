"""Where a joint fit begins whose stage is fixed: what is known of it, put into the fit with a free one."""

from dataclasses import replace

import numpy as np
import pytest

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.identify.walk.explained import _ahead

NAMES = ("friction", "slope", "stage")
START = [Parameter("friction", 1.0, 0.0, 3.0, "N", log=False), Parameter("slope", 2.0, 0.1, 90.0, "N/m")]
STAGE = Parameter("stage", 0.5, -9.0, 9.0, "m", log=False)


def line(seed: int) -> Residuals:
    """Linear in the coordinates of its three values, the second a logarithm; two of its columns alike."""
    random = np.random.default_rng(seed)
    columns = random.standard_normal((80, 3))
    columns[:, 2] = columns[:, 0] + 0.3 * columns[:, 1] + 0.2 * columns[:, 2]
    measured = columns @ [1.4, np.log(7.0), 0.2] + 0.01 * random.standard_normal(80)

    def of(values: dict[str, float]) -> np.ndarray:
        friction, slope, stage = (values[name] for name in NAMES)
        return columns @ [friction, np.log(slope), stage] - measured

    return Residuals(of, measured, None, "line", "m")


@pytest.mark.parametrize("stage", [-0.2, 0.2, 0.6])
def test_it_begins_where_a_linear_fit_ends(stage: float) -> None:
    loose = fit_least_squares([line(5)], [*START, STAGE])
    known = fit_least_squares([line(5)], [*START, STAGE._replace(start=stage, fixed=True)])
    ahead = _ahead(loose, {"stage": stage})
    assert set(ahead) == {"friction", "slope"}
    for name, value in ahead.items():
        assert value == pytest.approx(known.values[name], rel=1e-5)
        assert stage == 0.2 or value != pytest.approx(loose.values[name], rel=1e-2)


def test_it_stays_within_the_bounds() -> None:
    loose = fit_least_squares([line(5)], [*START, STAGE])
    assert _ahead(loose, {"stage": -8.0})["friction"] == 3.0


def test_without_derivatives_it_does_not_lead() -> None:
    loose = fit_least_squares([line(5)], [*START, STAGE])
    assert _ahead(replace(loose, jacobian=None), {"stage": 0.6}) == {}
    assert _ahead(replace(loose, jacobian=np.full((80, 3), np.nan)), {"stage": 0.6}) == {}
