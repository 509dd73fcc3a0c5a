"""Hysteresis and creep in exported code: against the solver, in both precisions, and what is refused."""

from __future__ import annotations

import json
from typing import Any

import fmpy
import numpy as np
import pytest

import stickslip as ss
from export.building import QUICK, QUICK_FLOAT, SANITIZED, scan, walk
from stickslip.export import ExportError, export_fmu
from stickslip.identify.results import model_numbers
from stickslip.physics.electronics import Amplifier
from stickslip.physics.piezo import BoucWen, Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii

BENT = ss.load_actuator("kang2007-hysteresis")
DRIVE = ss.Sawtooth(65.0, 20.0, periods=4)
SKEWED = PrandtlIshlinskii(
    (0.0, 5.0, 20.0), (0.8, 0.1, 0.1), (0.0, 30.0, 60.0), (0.02, -0.02, 0.01), (0.1, 0.05, -0.1)
)
PIEZOS = {
    "plays and creep": BENT.piezo,
    "skewed plays": Piezo(SKEWED, Creep.logarithmic(0.015, 0.1, 10.0)),
    "Bouc-Wen": Piezo(BoucWen(0.3, 0.01, 0.003)),
    "creep alone": Piezo(None, Creep.logarithmic(0.015, 0.01, 10.0)),
}


@pytest.mark.parametrize("case", PIEZOS)
def test_walk_is_the_solvers(case: str, tmp_path: Any) -> None:
    """In steps of 20 us, as that of an actuator without a piezo; a straight one goes elsewhere."""
    model = BENT.replace(piezo=PIEZOS[case])
    truth = ss.simulate(model, DRIVE, 0.2, sample_rate=1e3, tolerance=1e-10)
    expected = truth.end_effector_position.values
    straight = ss.simulate(BENT.replace(piezo=None), DRIVE, 0.2, sample_rate=1e3, tolerance=1e-10)
    assert np.max(np.abs(straight.end_effector_position.values - expected)) > 1e-7
    for flags in ((), QUICK_FLOAT):
        found = walk(model, tmp_path / f"c{len(flags)}", *flags, waveform=DRIVE)
        assert np.max(np.abs(found["end_effector_position"] - expected)) < 3e-8
        np.testing.assert_allclose(found["stage_position"], truth.stage_position.values, atol=2e-9)
        jumps = np.arange(201) % 50 == 0  # where a jump belongs to one side or the other
        assert found["drive_voltage"][~jumps] == pytest.approx(truth.drive_voltage.values[~jumps], abs=2e-3)


def test_creep_goes_on_in_single_precision(tmp_path: Any) -> None:
    """Increments of 2e-7 of what has crept, step by step: after 2 s at 60 V, within 0.1 % of the creep."""
    model = BENT.replace(piezo=Piezo(None, Creep((1.0, 100.0), (0.02, 0.02))), clamped=True)
    drive = ss.waveform.Sequence((ss.waveform.Ramp(6000.0, rise_time=0.01), 0.01), (ss.Constant(60.0), 1.99))
    found = walk(model, tmp_path / "c", *QUICK_FLOAT, waveform=drive, step="100 us", duration=2.0)
    truth = ss.simulate(model, drive, 2.0, sample_rate=1e2, tolerance=1e-10).stage_position.values
    creep = truth[-1] - model.gain * 60.0
    assert found["stage_position"][-1] == pytest.approx(truth[-1], abs=1e-3 * creep)


def test_feedforward_undoes_it(tmp_path: Any) -> None:
    """The example that scans a sine: off by less than a tenth of what the voltage of a line leaves."""
    motion = ss.Sine(2e-6, 10.0, offset=5e-6, periods=3, unit="m")
    columns = scan(BENT, tmp_path / "c", motion=motion)
    error = columns["end_effector_position"] - columns["wanted_position"]
    later = slice(columns.size // 3, None)
    assert np.std(error[later]) < 5e-9
    wanted, volts = columns["wanted_position"][later], columns["voltage"][later]
    line = np.polynomial.Polynomial.fit(wanted, volts, 1)(wanted)
    assert BENT.gain * np.std(volts - line) > 5e-8


def _scanned(seed: int) -> tuple[ss.Actuator, float]:
    """An actuator with a random piezo, and its stroke at rest at the greatest voltage, m."""
    random = np.random.default_rng(seed)
    thresholds, weights = (0.0, *np.sort(random.uniform(2.0, 60.0, 3))), random.uniform(0.05, 0.2, 3)
    bent = (
        PrandtlIshlinskii(thresholds, (random.uniform(0.8, 1.0), *weights)),
        BoucWen(random.uniform(0.1, 0.3), random.uniform(0.01, 0.05), random.uniform(-0.009, 0.009)),
        None,
        MaxwellCapacitor.of_plays(
            PrandtlIshlinskii(thresholds, (0.7, 0.1, 0.1, 0.1)), 1e-6, BENT.gain, BENT.stage_stiffness
        ),
    )[seed % 4]
    creep = None if seed % 4 == 3 else Creep.logarithmic(random.uniform(0.01, 0.03), 0.01, 100.0)
    model = BENT.replace(piezo=Piezo(bent, creep), max_voltage=random.uniform(100.0, 150.0))
    rest = ss.simulate(model, ss.Constant(model.max_voltage), 1e-3).stage_position.values
    return model, float(rest[0])


@pytest.mark.parametrize("seed", range(4))
def test_feedforward_begins_at_rest_and_reaches_as_far(seed: int, tmp_path: Any) -> None:
    """At 90 % of what the greatest voltage reaches, from the first row on; behind an amplifier the same."""
    model, stroke = _scanned(seed)
    motion = ss.Sine(0.02 * stroke, 2.0, -np.pi / 2, offset=0.9 * stroke, periods=1, unit="m")
    found = scan(model, tmp_path / "c", *SANITIZED, motion=motion, step=1e-4)
    wanted, volts = found["wanted_position"], found["voltage"]
    assert found["bits"].max() == 0
    assert np.max(np.abs(found["end_effector_position"] - wanted)) < 2e-3 * np.ptp(wanted)
    drive = ss.Sampled(found["time"], volts)
    truth = ss.simulate(model, drive, times=found["time"][:-1], tolerance=1e-10).end_effector_position.values
    assert np.max(np.abs(truth - wanted[:-1])) < 2e-2 * np.ptp(wanted)  # lines of 5 ms
    single = scan(model, tmp_path / "f", *QUICK_FLOAT, motion=motion, step=1e-4)
    np.testing.assert_allclose(single["voltage"], volts, rtol=2e-3)
    amplifier = Amplifier(12.5, -5.0, 1e6, 1e9, 10.0, -20.0, 200.0)
    behind = scan(
        model, tmp_path / "a", *QUICK, motion=motion, step=1e-4, amplifier=amplifier, piezo_capacitance=1e-9
    )
    np.testing.assert_allclose(12.5 * behind["voltage"] - 5.0, volts, rtol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_feedforward_beyond_reach_is_cut_and_said(seed: int, tmp_path: Any) -> None:
    model, stroke = _scanned(seed)
    motion = ss.Sine(0.05 * stroke, 2.0, -np.pi / 2, offset=stroke, periods=1, unit="m")
    found = scan(model, tmp_path / "c", *QUICK, motion=motion, step=1e-4)
    assert found["voltage"].max() == pytest.approx(model.max_voltage, rel=1e-8)  # nine digits
    assert (found["bits"][0], found["bits"][-1]) == (0, 1)


def test_it_comes_from_results_and_goes_into_an_fmu(tmp_path: Any) -> None:
    """An FMU of the results.json that has the piezo; its parameters change it."""
    file = tmp_path / "results.json"
    file.write_text(json.dumps({"numbers": {"model": model_numbers(BENT)}}))
    fmu = export_fmu(str(file), tmp_path / "fmu")
    times = np.arange(round(0.05 / 20e-6) + 1) * 20e-6
    samples = np.array(
        list(zip(times, DRIVE.value(times), strict=True)), dtype=[("time", float), ("voltage", float)]
    )
    how: dict[str, Any] = {"stop_time": 0.05, "output_interval": 20e-6, "input": samples}
    found = fmpy.simulate_fmu(str(fmu), output=["stage_position"], **how)["stage_position"][::50]
    truth = ss.simulate(BENT, DRIVE, 0.05, sample_rate=1e3, tolerance=1e-10).stage_position.values
    np.testing.assert_allclose(found[:49], truth[:49], atol=1e-8)
    more = {"piezo.hysteresis.weights[1]": BENT.piezo.hysteresis.weights[0] + 0.1}
    again = fmpy.simulate_fmu(str(fmu), output=["stage_position"], start_values=more, **how)
    assert again["stage_position"][2400] - found[48] == pytest.approx(
        0.1 * BENT.gain * samples["voltage"][2400], rel=0.02
    )


def test_what_is_not_exported_is_refused_by_name(tmp_path: Any) -> None:
    with pytest.raises(ExportError, match="'feedforward' is not for an actuator with a piezo"):
        export_fmu(BENT, tmp_path / "f", mode="feedforward")
    assert not list(tmp_path.iterdir())
