"""A static stage with bristles goes along lines; what jumps with it is said, in C and in FMUs."""

from __future__ import annotations

import io
import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from export.building import QUICK, QUICK_FLOAT, C, compiled, output, packaged_fmu
from export.test_fmu import instance
from stickslip.export import ExportError, export_c, export_fmu
from stickslip.quantities.units import QuantityError

H = 20e-6
KANG = ss.load_actuator("kang2007")
# Behind which the end-effector slips at the fall of the drive: 5 um of 7 um wrong, if it is a stair of jumps.
STATIC = ss.Actuator(
    gain=1.5e-8,
    natural_frequency=math.inf,
    damping_ratio=0.0,
    stage_mass=0.01,
    end_effector_mass=0.00986,
    friction=ss.LuGre(2.35e5, 49.8, 24.1, 0.392, 0.392),
    external_force=-0.1333,
)
KNOTS = ss.PeriodicKnots((0.0, 0.00304, 0.00726, 0.01328), (48.33, 75.24, 56.1, 13.58), 0.0384, periods=1)


def driven(made: Any, put: Any, got: Any, volts: np.ndarray, slopes: bool, step: float = H) -> np.ndarray:
    """Positions of the end-effector while an FMU gets voltages, and the slopes of the lines between them."""
    put("voltage", float(volts[0]))
    put("step", step)
    made.exitInitializationMode()
    found = [got("end_effector_position")]
    for k, (begin, end) in enumerate(zip(volts[:-1].tolist(), volts[1:].tolist(), strict=True)):
        put("voltage", begin)
        if slopes:
            made.setRealInputDerivatives([1], [1], [(end - begin) / H])
        made.doStep(currentCommunicationPoint=k * H, communicationStepSize=H)
        found.append(got("end_effector_position"))
    return np.array(found)


def test_an_fmu_goes_along_lines_and_refuses_a_stair(tmp_path: Path) -> None:
    fmu = export_fmu(STATIC, tmp_path / "fmu", fmi=2)
    times = np.arange(1921, dtype=np.float64) * H
    volts = KNOTS.value(times)
    truth = ss.simulate(STATIC, ss.Sampled(times, volts), times=times, tolerance=1e-9).end_effector_position
    said: list[str] = []
    for step in (H, 0.2 * H):
        made, put, got = instance(fmu, tmp_path / f"{step}", 2, said)
        off = driven(made, put, got, volts, True, step) - truth.values
        made.terminate()
        assert np.max(np.abs(off)) < 0.5e-9
        assert not said
        made, put, got = instance(fmu, tmp_path / f"{step} held", 2, said)
        with pytest.raises(Exception, match=r"failed|error|status"):
            driven(made, put, got, volts, False, step)
        assert ["the voltage jumps" in text and "natural_frequency" in text for text in said] == [True]
        assert "'step'" not in said.pop()


@pytest.mark.parametrize("mode", ["plant", "observer"])
def test_fmi_3_has_no_lines_for_it(mode: Any, tmp_path: Path) -> None:
    """Also where the stage is made static by a parameter of the FMU."""
    with pytest.raises(ExportError, match=r"static stage jumps .* fmi = 2"):
        export_fmu(STATIC, tmp_path / "fmu", fmi=3, mode=mode)
    assert not list(tmp_path.iterdir())
    for frequency in (KANG.natural_frequency, math.inf):
        said: list[str] = []
        made, put, _ = instance(packaged_fmu(3, mode), tmp_path / f"{frequency}", 3, said)
        put("natural_frequency", frequency)
        made.exitInitializationMode()
        put("voltage", 1.0)
        if math.isfinite(frequency):
            made.doStep(currentCommunicationPoint=0.0, communicationStepSize=H)
        else:
            with pytest.raises(Exception, match=r"failed|error|status"):
                made.doStep(currentCommunicationPoint=0.0, communicationStepSize=H)
        assert ["the voltage jumps" in text for text in said] == [True] * math.isinf(frequency)


@pytest.mark.parametrize(
    ("change", "jumps"),
    [
        ({}, True),
        ({"friction": ss.MaxwellSlip((1e5, 5e4), (0.3, 0.1))}, True),
        ({"friction": ss.Coulomb(0.392)}, False),
        ({"clamped": True}, False),
        ({"natural_frequency": 900.0, "damping_ratio": 0.02}, False),
    ],
    ids=str,
)
def test_a_held_step_of_the_code_says_that_it_jumps(change: Any, jumps: bool, tmp_path: Path) -> None:
    made = export_c(STATIC.replace(**change), tmp_path / "c")
    for flags in (QUICK, QUICK_FLOAT):
        text = output(compiled(made, C / "ticks.c", *flags), text="10 10 10.000001 30 30 nan 29")
        bits = [int(line.split()[2]) for line in text.splitlines()]
        assert bits == [0, 0, 0, 16 * jumps, 0, 2, 16 * jumps]


def test_a_waveform_that_jumps_is_refused_wherever_it_does(tmp_path: Path) -> None:
    """The one of an export without a waveform joins; so do the lines of its table, at every step."""
    for jumping in (
        ss.Sawtooth(65.0, 20.0, periods=3),
        ss.Sampled(np.array([0.0, 0.01, 0.02]), np.array([0.0, 5.0, 0.0]), "hold"),
    ):
        with pytest.raises(QuantityError, match="static stage jumps"):
            export_c(STATIC, tmp_path / "c", waveform=jumping)
    export_c(STATIC.replace(friction=ss.Coulomb(0.392)), tmp_path / "slides", waveform=jumping)
    for step, within in ((H, False), (3.7e-5, True)):  # whether its fall starts and ends within a step
        folder = export_c(STATIC, tmp_path / f"{step}", step=step)
        program = compiled(folder, folder / "host" / "walk.c")
        done = subprocess.run([program], capture_output=True, text=True, check=True)
        assert ("within a step of 3.7e-05 s the waveform differs by" in done.stderr) == within
        assert "jumps" not in done.stderr
        found = np.genfromtxt(io.StringIO(done.stdout), delimiter=",", names=True)
        assert np.ptp(found["end_effector_position"]) > 1e-6
