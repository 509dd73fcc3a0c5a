"""Derivatives by, and ensembles over, the numbers of a piezo; derivatives of the steady step after one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.physics.piezo import BoucWen, Creep, MaxwellCapacitor, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError
from stickslip.simulation import NotPeriodicError, steady_step_derivatives
from stickslip.simulation.varied import (
    model_names,
    piezo_names,
    put_in,
    record_value,
    value_of,
    with_values,
)

KANG = ss.load_actuator("kang2007")
PLAYS = PrandtlIshlinskii((0.0, 3.0, 9.0), (0.7, 0.15, 0.1), (20.0,), (0.1,), (0.02,))
CREEP = Creep((0.02, 0.3), (0.02, 0.01))
SAW = ss.Sawtooth(60.0, 40.0, rise_fraction=0.9)
KNOTS = ss.PeriodicKnots((0.0, 4e-3, 11e-3, 12.1e-3), (0.0, 40.0, 77.0, 10.0), 1 / 71)
# The widest element slips on its first way, and then only just: its state at the start of a period is on the
# edge of what it forgets.
PORT = MaxwellCapacitor(3e-7, (5e4, 9e4, 7e4), (0.2, 0.9, 1.4))
PIEZOS = {
    "plays": Piezo(PLAYS),
    "plays and creep": Piezo(PLAYS, CREEP),
    "Bouc-Wen": Piezo(BoucWen(0.3, 0.05, 0.02)),
    "Bouc-Wen and creep": Piezo(BoucWen(0.3, 0.05, 0.02), CREEP),
    "charge": Piezo(PORT._replace(charge_drive=True)),
}

pytestmark = pytest.mark.filterwarnings("ignore::stickslip.simulation.SimulationWarning")


def apart(model: Any, waveform: Any, name: str, share: float) -> tuple[list[Any], float]:
    """Model and waveform with a number a share less and more, and by how much they differ."""
    if name in model_names(model):
        h = share * value_of(model, name)
        return [
            (with_values(model, {name: value_of(model, name) + s * h}), waveform) for s in (-1, 1)
        ], 2.0 * h
    h = share * record_value(waveform, name)
    with_field = [
        type(waveform)(**put_in(waveform, {name: record_value(waveform, name) + s * h})) for s in (-1, 1)
    ]
    return [(model, one) for one in with_field], 2.0 * h


def agree(found: dict[str, float], model: Any, waveform: Any, share: float) -> None:
    """With differences of steady steps; numbers that hardly matter within 0.02 nm of all that they do."""
    for name, by in found.items():
        ends, h = apart(model, waveform, name, 1e-3)
        low, high = (ss.steady_step(*one, tolerance=1e-12) for one in ends)
        size = 0.5 * h / 1e-3
        assert by * size == pytest.approx((high - low) / 1e-3 * 0.5, rel=share, abs=2e-11), name


@pytest.mark.parametrize(
    ("piezo", "waveform"),
    [*((piezo, SAW) for piezo in PIEZOS), ("plays and creep", KNOTS), ("Bouc-Wen", KNOTS)],
    ids=lambda one: one if isinstance(one, str) else type(one).__name__,
)
def test_of_the_steady_step(piezo: str, waveform: Any) -> None:
    """By the waveform and by the piezo: of the drive once it repeats, not of its first curve."""
    model = KANG.replace(piezo=PIEZOS[piezo])
    of_waveform = ["amplitude", "frequency"] if waveform is SAW else ["value_2", "period"]
    names = [*of_waveform, "sigma_0", *(n for n in piezo_names(model) if value_of(model, n))]
    if "Bouc" in piezo:  # it hardly matters, and is not told from what the orbit of h is computed to
        names = [name for name in names if name != "piezo_time_constant_2"]
    # In the sum of what all numbers do, the parts of which may cancel, some are small.
    found = steady_step_derivatives(model, waveform, parameters=names, tolerance=1e-11)
    agree(found, model, waveform, 0.01)


@pytest.mark.parametrize("piezo", PIEZOS)
def test_of_a_trajectory(piezo: str) -> None:
    model, times = KANG.replace(piezo=PIEZOS[piezo]), np.linspace(0.0, 0.05, 40)
    names = ["amplitude", *(n for n in piezo_names(model) if value_of(model, n) and "stiff" not in n)]
    # Of a charge they matter to the voltage only; behind Bouc-Wen slow creep is not told from rounding.
    names = [name for name in names if "breakaway" not in name]
    if "Bouc" in piezo:
        names = [name for name in names if name != "piezo_time_constant_2"]
    found = ss.simulation.sensitivities(model, SAW, times=times, parameters=names, tolerance=1e-11).derivative
    for name in names:
        ends, h = apart(model, SAW, name, 1e-3)
        low, high = (ss.simulate(*one, times=times, tolerance=1e-12).end_effector_position for one in ends)
        by = (high - low) / h
        assert float(np.abs(found.sel(parameter=name) - by).max()) < 6e-3 * float(np.abs(by).max()), name


def test_cubics_of_creep_change_by_more_than_the_difference() -> None:
    """Their coefficients are cancellations: a millionth changes them by 228 times that, more does not."""
    creep = Creep((0.003, 0.04, 0.6), (0.01, 0.015, 0.01))
    model = KANG.replace(friction=ss.Dahl(2e6, 0.5), piezo=Piezo(PLAYS, creep))
    saw = ss.Sawtooth(73.2, 71.7, rise_fraction=0.93)
    names = ["amplitude", "frequency", "rise_fraction", "piezo_time_constant_3"]
    found = steady_step_derivatives(model, saw, parameters=names)
    agree(found, model, saw, 0.02)


@pytest.mark.parametrize("tolerance", [1e-9, 1e-12])
def test_an_element_that_only_just_slips(tolerance: float) -> None:
    """Whether it slips at all is a matter of the last digits there; the derivative is that of its way from
    rest, whatever the tolerance."""
    model = KANG.replace(piezo=Piezo(PORT))
    names = ["gain", "piezo_capacitance", "piezo_stiffness_3", "piezo_breakaway_2", "sigma_0"]
    found = steady_step_derivatives(model, KNOTS, parameters=names, tolerance=tolerance)
    for name in names:
        ends, h = apart(model, KNOTS, name, 1e-3)
        low, high = (ss.steady_step(*one, tolerance=1e-12) for one in ends)
        assert found[name] == pytest.approx((high - low) / h, rel=2e-3), name


def test_what_never_slips_keeps_how_it_began() -> None:
    model, weak = KANG.replace(piezo=Piezo(PORT)), ss.Sawtooth(12.0, 40.0, rise_fraction=0.9)
    assert math.isfinite(ss.steady_step(model, weak))
    with pytest.raises(NotPeriodicError, match="never slips within a period"):
        steady_step_derivatives(model, weak, parameters=["gain"])


@pytest.mark.parametrize("piezo", [*PIEZOS, "port"])
def test_members_are_what_one_after_the_other_gives(piezo: str) -> None:
    model, times = KANG.replace(piezo=PIEZOS.get(piezo, Piezo(PORT))), np.linspace(0.0, 0.03, 7)
    random = np.random.default_rng(3)
    names = [name for name in piezo_names(model) if value_of(model, name)]
    columns: dict[str, Any] = {n: value_of(model, n) * random.uniform(0.97, 1.03, 3) for n in names}
    columns["frequency"] = [40.0, 55.0, 47.0]
    walks = ss.simulate_ensemble(model, SAW, parameters=columns, times=times)
    steps = ss.steady_steps(model, SAW, parameters=columns)
    assert walks["piezo_weight_2" if "plays" in piezo else names[0]].attrs["units"] is not None
    for m in range(3):
        one = with_values(model, {name: float(columns[name][m]) for name in names})
        waveform = SAW._replace(frequency=columns["frequency"][m])
        alone = ss.simulate(one, waveform, times=times).end_effector_position.values
        np.testing.assert_allclose(walks.end_effector_position.values[m], alone, rtol=0, atol=1e-9)
        if float(steps["status"][m]) == 0.0:
            assert float(steps["net_step"][m]) == pytest.approx(ss.steady_step(one, waveform), abs=2e-10)
    assert np.sum(steps["status"].values == 0) >= 2


def test_a_member_whose_piezo_is_none_is_refused_alone() -> None:
    model = KANG.replace(piezo=Piezo(PLAYS, CREEP))
    columns = {"piezo_weight_2": [0.15, -0.1, 0.2, np.nan], "piezo_threshold_2": [3.0, 3.0, 9.5, 3.0]}
    found = ss.simulate_ensemble(model, SAW, 0.02, parameters=columns)
    reasons = found["reason"].values.tolist()
    assert reasons[0] == ""
    assert "PrandtlIshlinskii.weights[1] = -0.1 is out of range" in reasons[1]
    assert "thresholds [V] must ascend" in reasons[2]
    assert "not finite" in reasons[3]
    assert np.isnan(found["net_displacement"].values).tolist() == [False, True, True, True]


def test_units_and_names() -> None:
    model = KANG.replace(piezo=Piezo(PLAYS, CREEP))
    names = ["piezo_threshold_2", "piezo_time_constant_1", "piezo_share_2"]
    found = ss.simulation.sensitivities(model, SAW, 0.02, parameters=names)
    assert found.unit.values.tolist() == ["V", "s", ""]
    port = KANG.replace(piezo=Piezo(PORT))
    assert piezo_names(port)[:2] == ["piezo_capacitance", "piezo_stiffness_1"]
    assert piezo_names(KANG) == []
    with pytest.raises(QuantityError, match="did you mean 'piezo_weight_2'"):
        ss.simulation.sensitivities(model, SAW, 0.02, parameters=["piezo_weights_2"])
    with pytest.raises(QuantityError, match="did you mean 'piezo_share_1'"):
        ss.simulate_ensemble(model, SAW, 0.02, parameters={"piezo_shar_1": [0.1]})


def test_no_derivative_where_a_play_appears() -> None:
    model = KANG.replace(piezo=Piezo(PLAYS))
    with pytest.raises(QuantityError, match="piezo_threshold_1' at 0: after the piezo's hysteresis"):
        ss.simulation.sensitivities(model, SAW, 0.02, parameters=["piezo_threshold_1"])
