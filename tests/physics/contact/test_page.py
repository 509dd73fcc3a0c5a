"""The pages docs/contact.md and docs/compare-contacts.md: their programs run, and find what the pages say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from identify.stops import tribometer
from stickslip.physics.contact import ball_prior, load_pair, of_loop

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGE = "".join((DOCS / name).read_text(encoding="utf-8") for name in ("contact.md", "compare-contacts.md"))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The names that its programs leave, run one after the other."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        patch.setattr("stickslip.identify.walk.diagnosis.SECONDS", 0.0)  # no missing term is asked for
        names: dict[str, Any] = {}
        for code in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
            exec(code, names)
    return names


def test_fits_and_maps(page: dict[str, Any]) -> None:
    true, alone, helped = page["actuator"].friction, page["alone"], page["helped"]
    for fit in (alone, helped):
        for name in page["free"]:
            assert fit.values[name] == pytest.approx(getattr(true, name), rel=0.05)
    off = page["prior"].held(alone)
    assert -2.0 < off["sigma_0"] < -1.0
    assert abs(off["coulomb_force"]) < 0.1
    assert float(page["before"].net_step_low) < 3.0e-6 < float(page["before"].net_step_high)
    assert len(page["plan"].recordings) == 1


def test_loops(page: dict[str, Any]) -> None:
    assert page["again"].r_squared > 0.9999
    assert sum(page["law"].strength) == pytest.approx(page["ball"].slip_force)


def test_the_study(page: dict[str, Any]) -> None:
    """The figures that the page prints, and the truth of the file within them."""
    found = page["found"]
    said = PAGE[PAGE.index("    sigma_0 moved") : PAGE.index("True are the powers")]
    assert [line.strip() for line in said.strip().splitlines()] == found.report().splitlines()
    truth = [{k: v for k, v in one.cell.values.items()} for one in page["recorded"]]
    design = np.array(
        [[1.0, np.log(float(t["normal_force"].split()[0])), t["surface"] == "ground"] for t in truth]
    )
    for name, unit in (("sigma_0", "N/m"), ("coulomb_force", "N")):
        values = [ss.quantities.units.to_si(t[name], unit) for t in truth]
        _, power, ratio = np.linalg.lstsq(design, np.log(values), rcond=None)[0]
        for effect, value in (("normal_force", power), ("surface: ground over lapped", np.exp(ratio))):
            row = found.effects.sel(parameter=name, effect=effect)
            assert float(row["low"]) < value < float(row["high"])
            assert f"{value:.2f}" in PAGE[PAGE.index("True are") : PAGE.index("The normal force as")]
    assert found.moved("surface: ground over lapped") == ["sigma_0", "coulomb_force"]


def test_preload(page: dict[str, Any]) -> None:
    steps = page["steps"].net_step.values
    assert np.all(np.diff(steps) < 0.0)  # the more friction, the more of a step the flank takes back


def test_friction_over_the_load_as_measured() -> None:
    """A tribometer's load is taken off while it slides: Amontons' law, and the pair's prior holds."""
    part = tribometer(209.8, 211.7)
    load, force = part["normal_force"].values, -part["friction_force"].values
    for least in (0.3, 1.0):
        kept = (load > least) & (load < 4.95)
        y, x = np.log(force[kept]), np.log(load[kept])
        design = np.column_stack([np.ones(x.size), x])
        b = np.linalg.lstsq(design, y, rcond=None)[0]
        scores = design * (y - design @ b)[:, None]
        spread = scores.T @ scores
        for lag in range(1, 21):
            both = scores[lag:].T @ scores[:-lag]
            spread += (1.0 - lag / 21.0) * (both + both.T)
        bread = np.linalg.inv(design.T @ design)
        half = 1.96 * np.sqrt((bread @ spread @ bread)[1, 1])
        assert f"{b[1]:.3f} [{b[1] - half:.3f}, {b[1] + half:.3f}]" in PAGE
    middle = (load > 1.3) & (load < 4.3)
    ratio = float(np.mean(force[middle] / load[middle]))
    assert f"μ = {ratio:.3f} at" in PAGE
    steel = load_pair("steel-steel")
    off = np.log(ratio / steel.friction.friction_coefficient) / np.log(steel.friction.friction_factor)
    assert f"{off:.1f} standard deviations off" in PAGE


def test_stiffness_as_measured_is_that_of_the_rig() -> None:
    part = tribometer(60.0, 100.0)
    assert np.ptp(part["normal_force"].values) < 0.011
    found = of_loop(part["position"].values, part["friction_force"].values)
    stiffness = sum(found.law.stiffness)
    assert f"The loops have {stiffness / 1e3:.0f} kN/m" in PAGE
    assert sum(found.law.strength) == pytest.approx(0.457 * 5.0, rel=0.03)
    prior = ball_prior(load_pair("steel-steel"), "5 N", "5 mm")
    assert f"{prior.known['sigma_0'].value / 1e6:.0f} MN/m" in PAGE
    assert f"{prior.known['sigma_0'].value / stiffness:.0f} times as much" in PAGE
    assert f"and {-prior.held({'sigma_0': stiffness})['sigma_0']:.1f}\n" in PAGE
