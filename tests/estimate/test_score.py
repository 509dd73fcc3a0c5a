"""What one parameter more, or one less, would do to chi-squared."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.score import gain, rise, step, together

T = np.linspace(0.0, 1.0, 400)
COLUMNS = {"level": np.ones(T.size), "slope": T, "bend": np.sin(6.0 * T)}


def fitted(names: list[str], seed: int):
    """Straight-line problems: what is linearised is exact."""
    rng = np.random.default_rng(seed)
    data = 2.0 - 3.0 * T + rng.uniform(-0.3, 0.3) * COLUMNS["bend"] + 0.2 * rng.standard_normal(T.size)
    parameters = [Parameter(name, 0.5, -1e3, 1e3, log=False) for name in names]
    described = Residuals(lambda v: sum(v[n] * COLUMNS[n] for n in names) - data, data)
    return fit_least_squares([described], parameters)


@pytest.mark.parametrize("seed", range(2))
def test_both_are_what_a_fit_finds(seed: int) -> None:
    """Of white residuals every sample counts; how far they seem to is within a third of that."""
    less, more = fitted(["level", "slope"], seed), fitted(["level", "slope", "bend"], seed)
    fell = (less.cost - more.cost) / (more.cost / more.degrees_of_freedom)
    assert gain(less, COLUMNS["bend"]) == pytest.approx(fell, rel=0.35)
    assert rise(more, "bend") == pytest.approx(fell, rel=0.35)
    assert step(less, COLUMNS["bend"]) == pytest.approx(more.values["bend"], rel=1e-6)


@pytest.mark.parametrize("seed", range(1))
def test_several_at_once_are_what_a_fit_finds(seed: int) -> None:
    less, more = fitted(["level"], seed), fitted(["level", "slope", "bend"], seed)
    does = together(less, np.column_stack([COLUMNS["slope"], 1e-6 * COLUMNS["bend"]]))
    fell = (less.cost - more.cost) / (more.cost / more.degrees_of_freedom)
    assert does.gain == pytest.approx(fell, rel=0.35)
    assert does.share == pytest.approx(1.0 - more.cost / less.cost, rel=1e-9)
    assert does.steps == pytest.approx([more.values["slope"], 1e6 * more.values["bend"]], rel=1e-6)
    assert less.values["level"] + does.moves[0] == pytest.approx(more.values["level"], rel=1e-6)


def test_what_others_can_do_is_no_rise() -> None:
    COLUMNS["again"] = 2.0 - 4.0 * T
    try:
        assert rise(fitted(["level", "slope", "again"], 0), "again") == 0.0
    finally:
        del COLUMNS["again"]
