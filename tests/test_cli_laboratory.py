"""Commands of the laboratory."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from stickslip.calibration import load_calibration, read_table
from stickslip.cli import app


def run(*arguments: str):
    return CliRunner().invoke(app, [*arguments], prog_name="stickslip")


def test_calibrate(tmp_path: Path) -> None:
    done = run("calibrate", "kang2007-inductive", "--order", "5", "--out", str(tmp_path))
    assert done.exit_code == 0, done.stderr
    made = load_calibration(tmp_path / "calibration.json")
    np.testing.assert_allclose(made.coefficients, load_calibration("kang2007-inductive-5").coefficients)
    numbers = json.loads((tmp_path / "results.json").read_text())["numbers"]
    assert numbers["max_error"] == {"value": pytest.approx(5.4e-6, abs=0.1e-6), "unit": "m"}
    assert numbers["coefficients"]["c_2"]["unit"] == "m/V^2"
    assert numbers["coefficients"]["c_2"]["standard_error"] == pytest.approx(3.0e-6, rel=0.01)
    assert "kang2007" in (tmp_path / "report.html").read_text()


def test_calibrate_chooses_the_order_and_corrects_another_calibration(tmp_path: Path) -> None:
    """A caliper says 2 % more than the maker's polynomial: order 1 is found, with the slope 1.02."""
    first = load_calibration("kang2007-inductive-5")
    volts = np.linspace(0.5, 9.5, 12)
    true = 1.02e3 * first(volts) + 0.01 + 1e-5 * np.random.default_rng(0).standard_normal(12)
    rows = "\n".join(f"{y:.9f},{v:.9f}" for y, v in zip(true, volts, strict=True))
    path = tmp_path / "caliper.csv"
    path.write_text(f"caliper [mm],sensor [V]\n{rows}\n")
    out = tmp_path / "out"
    done = run("calibrate", str(path), "--after", "kang2007-inductive-5", "--out", str(out))
    assert done.exit_code == 0, done.stderr
    made = load_calibration(out / "calibration.json")
    assert (made.name, made.x_unit, made.y_unit) == ("caliper-1", "m", "m")
    np.testing.assert_allclose(made.coefficients, [1e-5, 1.02], rtol=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gone.csv"], "gone.csv"),
        (["kang2007-inductive", "--order", "five"], "--order five"),
        (["kang2007-inductive", "--order", "15"], "too few"),
        (["kang2007-inductive", "--after", "nobody"], "nobody"),
        (["kang2007-inductive", "--after", "kang2007-recalibration"], "takes m"),
    ],
)
def test_calibrate_refuses_in_one_line(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = run("calibrate", *arguments, "--out", str(tmp_path / "out"))
    assert done.exit_code == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
    assert read_table("kang2007-inductive").x_unit == "V"
