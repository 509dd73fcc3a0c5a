"""Actuators from data sheets: what is refused, what is reproduced, and what takes the draws."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import stickslip as ss
from stickslip import design
from stickslip.cli import app
from stickslip.design.sheet_density import Simulated
from stickslip.design.sheet_priors import NAMES, expectations
from stickslip.estimate.tempering import sample_tempered
from stickslip.parameters import references
from stickslip.parameters.load import load_set
from stickslip.quantities.units import QuantityError
from stickslip.report.views.data_sheet import sheet_document
from stickslip.simulation import SimulationWarning

KANG: dict[str, Any] = {
    "step": "10 um",
    "stroke": "17.4 um",
    "max_voltage": 150,
    "resonance": 525.7,
    "mass": "100 g",
    "stall_force": "150 mN",
    "title": "a stage",
}


@pytest.fixture(scope="module")
def made() -> design.SheetModel:
    return ss.from_data_sheet(**KANG, draws=120)


CONTRADICTIONS = {
    "speed = 5 mm/s is above frequency = 1 kHz times step = 1 µm, which is 1 mm/s": {
        "speed": "5 mm/s", "frequency": "1 kHz", "step": "1 um",
    },
    "blocking_force = 5 N is not stiffness = 1 MN/m times stroke = 1 µm, which is 1 N": {
        "blocking_force": 5, "stiffness": "1 N/um", "stroke": "1 um",
    },
    "step = 2 µm is above stroke = 1 µm": {"step": "2 um", "stroke": "1 um"},
    "step = 2 µm is above travel = 1 µm": {"step": "2 um", "travel": "1 um"},
    "stall_force = 3 N is above holding_force = 1 N": {"stall_force": 3, "holding_force": 1},
    "stall_force = 3 N is above blocking_force = 1 N": {"stall_force": 3, "blocking_force": 1},
    "current = 10 mA does not charge": {
        "current": "10 mA", "capacitance": "1 uF", "max_voltage": 100, "frequency": 1000,
    },
    "works 25 mJ, and the piezo is charged with 10 µJ": {
        "stall_force": 100, "step": "1 mm", "capacitance": "1 nF", "max_voltage": 100,
    },
}  # fmt: skip


@pytest.mark.parametrize("said", CONTRADICTIONS)
def test_a_sheet_that_contradicts_itself_is_refused_by_name(said: str) -> None:
    with pytest.raises(QuantityError, match="contradicts itself") as error:
        ss.from_data_sheet(**CONTRADICTIONS[said])
    assert said in str(error.value)


def test_what_rounding_explains_is_no_contradiction() -> None:
    sheet = design.DataSheet(speed="1.2 mm/s", frequency="1 kHz", step="1 um")
    assert sheet.numbers["step"] == 1e-6
    with pytest.raises(QuantityError, match="contradicts"):
        sheet._replace(tolerance=0.01)
    # A step measured far below the resonance is no bound of the speed at it.
    design.DataSheet(speed="37.73 mm/s", frequency=560, step="41 um", step_frequency=10)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"max_voltage": 100}, "says nothing of the step"),
        ({"speed": "1 mm/s"}, "speed with the frequency"),
        ({"step": "1 kg"}, "net step"),
        ({"step": -1e-6}, "out of range"),
        ({"stepp": 1e-6}, "did you mean 'step'"),
        ({"step": 1e-6, "max_voltage": -5}, "must be > min_voltage"),
        ({"sheet": 3}, "must be a design.DataSheet"),
        ({"step": 1e-6, "draws": 3}, "draws"),
    ],
)
def test_wrong_numbers_are_refused(numbers: dict[str, Any], said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        ss.from_data_sheet(**numbers)


def test_the_sheet_is_reproduced(made: design.SheetModel) -> None:
    """By the model, with the package's own calls, and by the draws."""
    assert ss.steady_step(made.model, made.drive) == pytest.approx(10e-6, rel=0.1)
    with warnings.catch_warnings():  # far from the stall force, one load misses the tolerance of 0.1 nm
        warnings.simplefilter("ignore", SimulationWarning)
        assert design.blocking_force(made.model, made.drive) == pytest.approx(0.15, rel=0.1)
    assert made.model.gain * 150 == pytest.approx(17.4e-6, rel=0.1)
    of = made.dataset
    assert np.all(of["predicted_low"] < of["stated"])
    assert np.all(of["stated"] < of["predicted_high"])
    # 95 % of the draws are within the tolerance, but for what the prior and the number of draws allow.
    assert np.all(of["predicted_high"] < 1.2 * of["stated"])
    assert np.all(of["predicted_low"] > of["stated"] / 1.2)


def test_what_the_sheet_says_nothing_of_is_told(made: design.SheetModel) -> None:
    assert {"gain", "natural_frequency", "end_effector_mass"} <= set(made.determined)
    assert {"stage_mass", "sigma_1"} <= set(made.open)
    assert set(made.determined) | set(made.open) == set(NAMES)
    width = made.dataset["width"].sel(parameter="sigma_1")
    assert width > 0.5
    text = made.report()
    assert "leaves open" in text
    assert "assumption: damping ratio of the bristle" in text
    assert "the sheet prints it" in text
    assert "stall_force: given" in made.citation


def test_a_voltage_that_the_sheet_does_not_print_is_an_assumption(tmp_path: Path) -> None:
    """A gain in m/V needs a voltage: it is open, also where the stroke is printed, and the report says so."""
    found = ss.from_data_sheet(step="10 um", speed="3 mm/s", frequency="400 Hz", draws=120)
    assert "gain" in found.open
    assert list(found.assumptions) == ["max_voltage"]
    first = found.report().splitlines()[2]
    assert first.startswith("Assumed max_voltage: 100 V")
    gain = next(line for line in found.report().splitlines() if line.startswith("gain"))
    assert "assumption: stroke of 1.5 steps over an assumed 100 V" in gain
    document = sheet_document(found)
    assert document.assumptions[0].startswith("max_voltage: 100 V")
    assert "gain" not in dict(document.highlights)
    model = found.save(tmp_path) / "model.toml"
    assert load_set(model).values["max_voltage"].assumed
    assert not load_set(model).values["gain"].assumed
    assert ss.load_actuator(model).max_voltage == 100.0
    stroke = ss.from_data_sheet(stroke="10 um", min_voltage=-20, draws=100)
    assert "gain" in stroke.open
    assert "80 V" in stroke.assumptions["max_voltage"]
    printed = {"stroke": "10 um", "draws": 100}
    assert not ss.from_data_sheet(max_voltage=100, **printed).assumptions  # type: ignore[arg-type]
    path = tmp_path / "sheet.toml"
    voltage = '[max_voltage]\nvalue = 100\nunit = "V"\nassumed = true\nreason = "as its drive"\n'
    path.write_text(f'title = "x"\ncitations = []\nkind = "data_sheet"\n{voltage}', encoding="utf-8")
    of_file = ss.from_data_sheet(path, **printed)  # type: ignore[arg-type]
    assert "gain" in of_file.open
    assert of_file.assumptions == {"max_voltage": "as its drive"}


def test_without_data_the_draws_are_those_expected() -> None:
    """Nothing to reproduce: the posterior is what was expected, and its medians are the expected values."""
    found = ss.from_data_sheet(stroke="10 um", max_voltage=100, mass=0.05, draws=2000)
    expected = expectations(found.sheet).known
    for name in ("gain", "damping_ratio", "end_effector_mass", "coulomb_force"):
        values = np.log(found.posterior.samples[name].values.ravel())
        spread = np.log(expected[name].factor)
        assert np.mean(values) == pytest.approx(np.log(expected[name].value), abs=0.12 * spread)
        assert np.std(values) == pytest.approx(spread, rel=0.08)


def test_the_sampler_finds_a_posterior_that_is_known() -> None:
    """A measurement of the sum of two coordinates with the deviation 0.1: normal, by conditioning."""

    def log_likelihood(points: np.ndarray, least: np.ndarray) -> np.ndarray:
        found = -0.5 * ((points[:, 0] + points[:, 1] - 1.0) / 0.1) ** 2
        return np.where(found >= least, found, -np.inf)

    found = sample_tempered(
        log_likelihood, 3, lambda z: {"a": z[:, 0], "b": z[:, 1], "c": z[:, 2]},
        [("a", ""), ("b", ""), ("c", "")], draws=4000, seed=1,
    )  # fmt: skip
    assert found.converged, found.message
    a, b, c = (found.samples[name].values.ravel() for name in "abc")
    variance = 2.0 + 0.01  # of the sum and its measurement, before
    assert np.mean(a) == pytest.approx(1.0 / variance, abs=0.05)
    assert np.var(a) == pytest.approx(1.0 - 1.0 / variance, rel=0.1)
    assert np.std(a + b) == pytest.approx(np.sqrt(2.0 - 4.0 / variance), rel=0.1)
    assert np.mean(c) == pytest.approx(0.0, abs=0.08)
    assert np.std(c) == pytest.approx(1.0, rel=0.06)


def test_a_likelihood_below_its_bound_is_not_computed_to_its_end() -> None:
    sheet = design.DataSheet(**KANG)
    simulated = Simulated.of(sheet, expectations(sheet))
    points = np.random.default_rng(0).standard_normal((12, len(NAMES)))
    whole = simulated.log_likelihood(points, np.full(12, -np.inf))
    least = np.median(whole[np.isfinite(whole)])
    found = simulated.log_likelihood(points, np.full(12, least))
    kept = whole >= least
    assert 0 < kept.sum() < 12
    np.testing.assert_array_equal(found[kept], whole[kept])
    assert np.all(np.isneginf(found[~kept]))


def test_maps_designs_loops_and_plans_take_it(made: design.SheetModel) -> None:
    found = ss.step_map(
        made.model, made.drive, load=[0.0, -0.1], fit=made.posterior, draws=40, tolerance=1e-8
    )
    assert np.all(found["net_step_low"] < found["net_step_high"])
    assert found["net_step"].values[0] > found["net_step"].values[1]
    tuning = ss.control.tune(made.model, "50 kHz", posterior=made.posterior)
    assert tuning.models > 1
    assert "leaves open" in str(ss.view(made))
    axes = ss.plot(made)
    assert next(label.get_text() for label in axes[0].get_yticklabels()) == "step\n10 µm"


def test_what_the_thesis_identified_is_within_what_its_parts_let_expect() -> None:
    """Its friction and damping were no numbers of the sheet; a walk of the plan would determine them."""
    found, thesis = ss.from_data_sheet("kang2007", draws=400), ss.load_actuator("kang2007")
    known = thesis._asdict() | thesis.friction._asdict()
    for name in ("damping_ratio", "coulomb_force", "sigma_0", "sigma_1"):
        row = found.dataset.sel(parameter=name)
        assert row["low"] < known[name] < row["high"], name
        assert name in found.open
    plan = found.plan(recordings=1, duration="0.2 s", sample_rate="5 kHz")
    widths = plan.dataset["half_width"].sel(parameter=["damping_ratio", "coulomb_force", "sigma_0"])
    assert np.all(widths.values < 0.1)


def test_the_sheets_of_the_package_have_sources() -> None:
    names = design.available_data_sheets()
    assert len(names) >= 4
    for name in names:
        found = design.load_data_sheet(name)
        assert found.sources.keys() >= found.sheet.numbers.keys() - {"min_voltage"}
        assert all(found.sources.values())
        assert set(found.citations) <= references().keys()


def test_a_wrong_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(QuantityError, match=r"no data sheet 'picomoter' \(did you mean 'picomotor'"):
        ss.from_data_sheet("picomoter")
    path = tmp_path / "mine.toml"
    path.write_text('title = "x"\ncitations = []\nkind = "stack"\n', encoding="utf-8")
    with pytest.raises(QuantityError, match="kind = 'stack' must be 'data_sheet'"):
        ss.from_data_sheet(path)


def test_the_command_writes_what_design_files_take(tmp_path: Path) -> None:
    given = ["--set", "step=67 nm", "--set", "frequency=500 Hz", "--set", "max_voltage=50"]
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["data-sheet", *given, "--draws", "200", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "leaves open" in done.output
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    assert results["numbers"]["reproduced"]["step"]["value"] == pytest.approx(67e-9, rel=0.1)
    assert "F_C/σ_0 of a 15th of the stroke" in (out / "report.html").read_text(encoding="utf-8")
    spread = {
        "kind": "design", "title": "t", "model": "model.toml", "uncertainty": "posterior.nc",
        "map": {"drive": {"shape": "Sawtooth", "fields": {"amplitude": "50 V", "frequency": "500 Hz"}},
                "voltage": ["30 V", "50 V"], "draws": 40},
    }  # fmt: skip
    (out / "map.yaml").write_text(yaml.safe_dump(spread), encoding="utf-8")
    done = CliRunner().invoke(app, ["design", str(out / "map.yaml"), "--out", str(tmp_path / "map")])
    assert done.exit_code == 0, done.output
    wrong = CliRunner().invoke(app, ["data-sheet", "--set", "step 67 nm", "--out", str(out)])
    assert wrong.exit_code == 2
    assert "write NUMBER=VALUE" in wrong.output


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("draws=120", "no number 'draws' (an option of the command: --draws)"),
        ("seed=3", "--seed"),
        ("progress=1", "no number 'progress'"),
        ("sheet=kang2007", "no number 'sheet'"),
        ("stepp=1 um", "did you mean 'step'"),
    ],
)
def test_the_command_sets_numbers_of_the_sheet_only(change: str, said: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["data-sheet", "--set", "step=10 um", "--set", change, "--out", str(tmp_path)]
    )
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
