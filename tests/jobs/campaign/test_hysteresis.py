"""A campaign on the hysteretic bench: hysteresis and creep, mode, friction, prediction; and what it says of a
stage without them."""

from __future__ import annotations

import importlib.resources
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.identify.results import model_of

EXAMPLES = Path(str(importlib.resources.files("stickslip") / "examples"))
CAMPAIGN = yaml.safe_load((EXAMPLES / "kang2007_hysteresis_campaign.yaml").read_text("utf-8"))
TRUTH = ss.load_actuator("kang2007-hysteresis")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Loops, two steps, two walks of 20 Hz: short, and all that such a campaign is."""
    made = tmp_path_factory.mktemp("hysteresis")
    experiment = yaml.safe_load((EXAMPLES / "kang2007_hysteresis_experiment.yaml").read_text("utf-8"))
    loops, step, _, walk = experiment["runs"]
    step["matrix"] = {"voltage": ["50 V", "80 V"]}
    walk["matrix"] = {"voltage": ["65 V", "75 V"]}
    experiment["runs"] = [loops, step, walk]
    (made / "experiment.yaml").write_text(yaml.safe_dump(experiment), "utf-8")
    return made


def ran(folder: Path, name: str, uses: list[dict], **changes):
    file = {**CAMPAIGN, "experiment": "experiment.yaml", "recordings": uses, "hops": 0, **changes}
    (folder / f"{name}.yaml").write_text(yaml.safe_dump(file), "utf-8")
    done = CliRunner().invoke(
        app, ["campaign", str(folder / f"{name}.yaml"), "--no-figures", "--out", str(folder / "out")]
    )
    return done, json.loads((folder / "out" / "results.json").read_bytes())


def test_the_campaign_finds_stage_and_friction_and_predicts(folder: Path) -> None:
    done, results = ran(
        folder,
        "bent",
        [
            {"cells": "loops", "use": "piezo"},
            {"cells": "step_*", "use": "step"},
            {"cells": "*65V", "use": "fit"},
            {"cells": "*", "use": "verify"},
        ],
        require=["r_squared > 0.98"],
    )
    assert done.exit_code == 0, done.output
    numbers = results["numbers"]
    assert numbers["hysteresis"]["straight_line"]["over_fit"]["value"] > 10.0
    for name, true in (("sigma_0", 1.399e6), ("sigma_1", 34.9), ("coulomb_force", 0.5401)):
        found = numbers["friction"]["parameters_with_all_errors"][name]
        away = np.log(found["value"] / true) / (found["standard_error"] / found["value"])
        assert abs(away) < 3.5, name
    for name in ("natural_frequency", "damping_ratio"):
        found = numbers["stage"]["parameters"][name]
        assert abs(found["value"] - getattr(TRUTH, name)) < 4.0 * found["standard_error"], name
    model = model_of(numbers["model"])
    assert model.piezo is not None
    way = [0.0, 75.0, 0.0, 40.0]  # what it makes of a way, whatever its plays are
    strokes = [one.gain * one.piezo.hysteresis.output(way) for one in (model, TRUTH)]
    np.testing.assert_allclose(strokes[0], strokes[1], atol=0.02 * strokes[1].max())
    page = (folder / "out" / "report.html").read_text("utf-8")
    assert "Hysteresis and creep" in page
    assert "a stage without hysteresis and creep does not explain these recordings" in page.lower()


@pytest.mark.usefixtures("no_term_is_tried")
def test_a_linear_stage_is_said_not_to_explain_the_same_recordings(folder: Path) -> None:
    done, results = ran(
        folder,
        "straight",
        [{"cells": "step_*", "use": "step"}, {"cells": "*65V", "use": "fit"}],
        require=[],
    )
    assert done.exit_code == 1
    assert "does not explain" in done.output.replace("\n", " ")
    lacks = results["numbers"]["friction"]["lack_of_fit"]
    assert any(one["seen"] for one in lacks.values())
    assert "hysteresis" not in results["numbers"]
