"""All laws on the same loops."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.friction import LAWS, MaxwellSlip
from stickslip.identify.loops.compare import candidates, compare_laws

from ..stops import made_loops

STIFFNESS, STRENGTH = (4e4, 1.5e4), (1.2, 0.9)


def test_every_law_is_a_candidate() -> None:
    listed = candidates(made_loops(STIFFNESS, STRENGTH))
    assert {type(c.model) for c in listed} == set(LAWS)
    assert [len(c.model.strength) for c in listed if isinstance(c.model, MaxwellSlip)] == [1, 2, 3, 4]
    assert len({c.label for c in listed}) == len(listed)


def test_the_law_that_made_the_loops_wins() -> None:
    train = made_loops(STIFFNESS, STRENGTH, noise=0.02, bias=0.1)
    unseen = made_loops(STIFFNESS, STRENGTH, noise=0.02, bias=0.1, seed=1, begin=5.0)
    laws = [c for c in candidates(train, 2) if c.label in {"Dahl", "LuGre", "ResetIntegrator"}]
    laws += [c for c in candidates(train, 2) if isinstance(c.model, MaxwellSlip)]
    seen = []
    found = compare_laws(
        train,
        unseen,
        laws,
        reference_normal_force=5.0,
        progress=lambda *told: seen.append(told),
    )
    assert found.best == "MaxwellSlip, 2 elements"
    assert seen[0] == ("fitting Dahl", 0.0)
    table = found.table
    assert list(table["law"].values) == [c.label for c in laws]
    best = table.sel(law=found.best)
    assert int(best["n_parameters"]) == 5
    assert best["bic"] == table["bic"].min()
    assert bool(best["converged"])
    # The noise of 0.02 N is all that is left, in what was fitted and in what was not.
    assert float(best["verification_rmse"]) == pytest.approx(0.02, rel=0.15)
    fit = found.fits[found.best]
    assert fit.predict is not None
    residual = fit.predict(unseen) - unseen["friction_force"].values
    shown = unseen["friction_force"].values
    r_squared = 1 - np.sum(residual**2) / np.sum((shown - shown.mean()) ** 2)
    assert float(best["verification_r_squared"]) == pytest.approx(r_squared, rel=1e-12)
    lines = found.report().splitlines()
    assert len(lines) == 6
    assert lines[-1].startswith("MaxwellSlip, 2 elements")
    # One element is the reset integrator: the same equations in other names.
    alike = table.sel(law=["ResetIntegrator", "MaxwellSlip, 1 element"])["verification_r_squared"].values
    assert alike[0] == pytest.approx(alike[1], abs=1e-4)
