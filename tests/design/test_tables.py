"""Look-up tables for a controller: the numbers of the map, and the same from CSV and from C."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

import stickslip as ss
from stickslip import design
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")


def banded(direction: int = 1) -> design.StepTable:
    """With a band that is made up: that of a fit is tested with the fits."""
    volts = np.linspace(10.0, 160.0, 31)
    found = ss.step_map(KANG, voltage=volts, frequency=50.0, direction=direction)
    low, high = 0.9 * found.net_step - 1e-9, 1.1 * found.net_step + 1e-9
    return design.step_table(found.assign(net_step_low=low, net_step_high=high))


def test_numbers_of_the_map() -> None:
    found = ss.step_map(KANG, voltage=[90.0, 30.0, 60.0, 155.0], frequency=50.0)
    table = design.step_table(found)
    assert table.voltages.tolist() == [30.0, 60.0, 90.0]  # those beyond the range are left out
    step, low, _ = design.step_at(table, [45.0, 20.0])
    s = {v: float(found.net_step.sel(voltage=v)) for v in (30.0, 60.0, 90.0)}
    assert step[0] == pytest.approx(0.5 * (s[30.0] + s[60.0]))
    assert np.isnan(step[1])
    assert np.all(np.isnan(low))
    assert table.interpolation_error == pytest.approx(abs(s[60.0] - 0.5 * (s[30.0] + s[90.0])))
    assert design.voltage_for(table, float(step[0])) == pytest.approx(45.0)
    assert "frequency = 50 Hz" in table.conditions
    true = float(ss.step_map(KANG, voltage=45.0, frequency=50.0).net_step)
    assert abs(true - step[0]) < table.interpolation_error
    with pytest.raises(QuantityError, match="is out of range: the table has"):
        design.voltage_for(table, "1 mm")


def test_csv(tmp_path: Path) -> None:
    table = banded()
    path = design.save_step_table(table, tmp_path / "steps.csv")
    read = np.loadtxt(path, delimiter=",", comments="#", skiprows=4)
    np.testing.assert_array_equal(read, np.column_stack([table.voltages, table.steps, table.low, table.high]))
    assert path.read_text().splitlines()[3].startswith("voltage [V],net_step [m]")


@pytest.mark.parametrize("direction", [1, -1])
def test_c_header(tmp_path: Path, direction: int) -> None:
    table = banded(direction)
    design.save_step_table(table, tmp_path / "axis.h", name="axis")
    asked = [5.0, 10.0, 33.3, 77.0, 150.0, 150.1]
    wanted = [float(0.3 * table.steps[0] + 0.7 * table.steps[-1]), 1.0]
    calls = "".join(
        f'    printf("%.17g %.17g %.17g\\n", axis_at({v!r}), axis_low({v!r}), axis_high({v!r}));\n'
        for v in asked
    )
    calls += "".join(f'    printf("%.17g 0 0\\n", axis_voltage({v!r}));\n' for v in wanted)
    twice = '#include <stdio.h>\n#include "axis.h"\n#include "axis.h"\n\n'
    source = f"{twice}int main(void)\n{{\n{calls}    return 0;\n}}\n"
    (tmp_path / "main.c").write_text(source)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["gcc", *flags, "main.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    out = subprocess.run(["./main"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    found = np.array([[float(word) for word in line.split()] for line in out.splitlines()])
    np.testing.assert_allclose(found[:6], np.column_stack(design.step_at(table, asked)), rtol=1e-13)
    assert np.isnan(found[0, 0])
    assert found[6, 0] == pytest.approx(design.voltage_for(table, wanted[0]), rel=1e-13)
    assert np.isnan(found[7, 0])


def test_what_is_no_table(tmp_path: Path) -> None:
    found = ss.step_map(KANG, voltage=[30.0, 60.0, 90.0, 120.0], frequency=[20.0, 50.0])
    with pytest.raises(QuantityError, match="over voltage"):
        design.step_table(found)
    one = found.sel(frequency=50.0)
    with pytest.raises(QuantityError, match="at 60 V there is no steady step"):
        design.step_table(one.where(one.voltage != 60.0))
    with pytest.raises(QuantityError, match="2 voltages"):
        design.step_table(one.isel(voltage=[0, 1]))
    table = design.step_table(one)
    with pytest.raises(QuantityError, match=r"to .csv or .h"):
        design.save_step_table(table, tmp_path / "x.txt")
    with pytest.raises(QuantityError, match="no name in C"):
        design.save_step_table(table, tmp_path / "x.h", name="1st")
    bent = table._replace(steps=np.array([0.0, 2.0, 1.0, 3.0]))
    with pytest.raises(QuantityError, match="not monotone"):
        design.voltage_for(bent, 1.0)
    assert "_voltage(double" not in design.save_step_table(bent, tmp_path / "b.h").read_text()
