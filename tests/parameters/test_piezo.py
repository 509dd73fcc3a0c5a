"""A piezo in a parameter set: read, written, said where it is from; and what is wrong in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip.parameters import ParameterSetError
from stickslip.parameters.writing import parameter_text
from stickslip.physics.piezo import Creep, Piezo, PrandtlIshlinskii

SET = "kang2007-hysteresis"


def test_the_set_has_what_it_says() -> None:
    """Loops open by 13 % of the stroke at 150 V and 3 % at 20 V; 1.5 % of creep per decade."""
    actuator = ss.load_actuator(SET)
    assert actuator.piezo is not None
    hysteresis = actuator.piezo.hysteresis
    for volts, percent in ((150.0, 13.0), (100.0, 10.0), (20.0, 3.0)):
        way = np.linspace(0.0, volts, 2001)
        y = hysteresis.output(np.concatenate([way, way[::-1], way, way[::-1]]))
        up, down = y[4002:6003], y[6003:][::-1]
        assert 100.0 * np.max(down - up) / (up[-1] - up[0]) == pytest.approx(percent, abs=0.6)
        if volts == 150.0:
            plain = ss.load_actuator("kang2007")
            assert actuator.gain * (up[-1] - up[0]) == pytest.approx(plain.gain * volts, rel=2e-3)
    # its time constants have three digits
    assert actuator.piezo.creep.per_decade == pytest.approx(0.015, rel=5e-4)
    assert {"piezo.hysteresis.weights", "piezo.creep.shares"} <= set(actuator.assumptions)


def test_it_is_written_and_read_again(tmp_path: Path) -> None:
    actuator = ss.load_actuator("kang2007").replace(
        piezo=Piezo(PrandtlIshlinskii((0.0, 4.0), (0.9, 0.1), (20.0,), (-0.01,)), Creep((1.0,), (0.02,)))
    )
    file = tmp_path / "mine.toml"
    file.write_text(parameter_text(actuator, "mine", "a test"), encoding="utf-8")
    again = ss.load_actuator(file)
    assert again.piezo == actuator.piezo
    changed = again.replace(piezo=Piezo(again.piezo.hysteresis))  # type: ignore[union-attr]
    assert "piezo.creep" in changed.citation


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    text = (Path(ss.__file__).parent / "parameters" / "sets" / f"{SET}.toml").read_text(encoding="utf-8")
    for old, new, said in (
        ('model = "Creep"', 'model = "Crepe"', r"\[piezo.creep\] model = 'Crepe'.*did you mean 'Creep'"),
        ("[piezo.creep", "[piezo.crepp", r"\[piezo.crepp\] is unknown \(did you mean 'creep'"),
        ("[0.58, 0.03", "[-0.58, 0.03", r"\[piezo.hysteresis\].*weights\[0\] = -0.58 is out of range"),
        ('unit = "V"\nsymbol = "r_i"', 'unit = "um"\nsymbol = "r_i"', r"\[piezo.hysteresis\].*thresholds"),
    ):
        assert old in text
        (file := tmp_path / "wrong.toml").write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(ParameterSetError, match=said):
            ss.load_actuator(file)
