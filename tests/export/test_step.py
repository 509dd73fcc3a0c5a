"""What the example's walk says of a step that is too long."""

from __future__ import annotations

import io
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from export.building import compiled, walk
from stickslip import Actuator, simulate
from stickslip.export import export_c, table
from stickslip.friction import Elastoplastic, LuGre, StictionCoulombViscous
from stickslip.waveform.periodic import Sawtooth

UNAFFECTED = {"stage_reaction": False, "stage_mass": 0.02}
# A stiff contact near its breakaway, of which a jump of the drive breaks one loose within a step ...
LUGRE = Actuator(
    gain=1.033e-7,
    natural_frequency=1.087e5,
    damping_ratio=0.355,
    end_effector_mass=3.12e-3,
    friction=LuGre(9.6e7, 37.7, 0.036, 0.755, 0.875, 6.06e-4),
    external_force=0.764,
    **UNAFFECTED,
)
ELASTOPLASTIC = Actuator(
    gain=7.247e-8,
    natural_frequency=5.116e4,
    damping_ratio=0.163,
    end_effector_mass=1.95e-3,
    friction=Elastoplastic(8.64e7, 271.0, 0.0, 0.1888, 0.2544, 1.37e-9, 2.09e-4),
    external_force=-0.1818,
    **UNAFFECTED,
)
# ... and a drive that jumps between two steps, of a contact without stiffness.
OFF_THE_STEPS = Actuator(
    gain=6.066e-8,
    natural_frequency=5.264e4,
    damping_ratio=0.5086,
    end_effector_mass=1.844e-3,
    friction=StictionCoulombViscous(0.15765, 0.15765, 0.0),
    external_force=-0.07962,
    **UNAFFECTED,
)


def error_and_said(model: Actuator, drive: Sawtooth, step: float, folder: Path) -> tuple[float, float]:
    """The greatest error of the walk, and by how much half the step leads elsewhere; of the path."""
    export_c(model, folder, waveform=drive, step=step)
    program = compiled(folder, folder / "host" / "walk.c", "-O2")
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    found = np.genfromtxt(io.StringIO(done.stdout), delimiter=",", names=True)
    # Less is not always to be had: a rounding decides at which jump of the drive such a contact breaks loose.
    truth = simulate(model, drive, times=found["time"], tolerance=1e-7)["end_effector_position"].values
    path = np.abs(
        np.diff(simulate(model, drive, sample_rate=2e4, tolerance=1e-7)["end_effector_position"].values)
    ).sum()
    said = re.search(r"too long a step .* (\S+) % of its path", done.stderr)
    assert bool(said) == bool(done.stderr)
    error = float(np.max(np.abs(found["end_effector_position"] - truth))) / path
    return error, float(said.group(1)) / 100 if said else 0.0


@pytest.mark.parametrize(
    ("model", "frequency", "least", "short"),
    [(LUGRE, 20.0, 0.3, 1e-6), (ELASTOPLASTIC, 18.1, 0.3, 0.25e-6), (OFF_THE_STEPS, 18.1, 0.03, 1e-6)],
)
def test_a_step_that_is_too_long_is_said(model, frequency, least, short, tmp_path) -> None:
    drive = Sawtooth(65.0, frequency, periods=3)
    error, said = error_and_said(model, drive, 20e-6, tmp_path / "long")
    assert error > least
    assert 0.4 * error < said < 3.0 * error
    error, said = error_and_said(model, drive, short, tmp_path / "short")
    assert (error < 0.01, said) == (True, 0.0)


def test_a_waveform_that_half_the_step_has_no_table_for_is_exported(tmp_path, monkeypatch) -> None:
    """It was refused for the check of its step alone."""
    drive = Sawtooth(65.0, 18.1, periods=3)
    whole = table.played(drive, 20e-6, None)
    monkeypatch.setattr(table, "_MOST_STEPS", whole.steps)
    half = table.in_half(whole, drive, 20e-6, None)
    assert half.steps == 2 * whole.steps
    assert [line.begin for line in half.lines] == [line.begin for line in whole.lines]
    found = walk("kang2007", tmp_path / "c", waveform=drive)
    assert np.isfinite(found["end_effector_position"]).all()
