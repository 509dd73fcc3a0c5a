"""What the drives of an ensemble and of periodic motions ask of an amplifier, against a run's own account."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.physics.electronics import Stack, electrical
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007")
STACK = Stack("1.8 uF", 0.02, 8.0, "150 V", 20.0, 5.0)
WALK = ss.Sawtooth("65 V", "50 Hz", rise_fraction=0.95, periods=3)
RANDOM = np.random.default_rng(11)
COLUMNS = {
    "amplitude": RANDOM.uniform(30.0, 100.0, 5),
    "frequency": RANDOM.uniform(20.0, 400.0, 5),
    "rise_fraction": RANDOM.uniform(0.6, 0.97, 5),
    "sigma_0": RANDOM.uniform(1e6, 2e6, 5),
}


@pytest.mark.parametrize("call", [ss.simulate_ensemble, ss.steady_steps])
def test_each_member_asks_for_what_its_own_run_accounts(call: Any) -> None:
    drive = WALK if call is ss.simulate_ensemble else ss.Sawtooth("65 V", "50 Hz", rise_fraction=0.95)
    found = call(KANG, drive, parameters=COLUMNS, stack=STACK)
    for m in range(5):
        own = {name: float(column[m]) for name, column in COLUMNS.items() if name != "sigma_0"}
        run = electrical(ss.Sawtooth(**own, periods=40), STACK)
        assert float(found.peak_current[m]) == pytest.approx(float(run.peak_current), rel=1e-6)
        assert float(found.rms_current[m]) == pytest.approx(float(run.rms_current), rel=1e-6)
        assert float(found.heat[m]) == pytest.approx(float(run.mean_loss), rel=0.02)  # a run has ends
        above = STACK.thermal_resistance * float(found.heat[m])
        assert float(found.temperature_rise[m]) == pytest.approx(above)
    assert found.peak_current.attrs["units"] == "A"
    plain = call(KANG, drive, parameters=COLUMNS)
    np.testing.assert_array_equal(plain.error_estimate, found.error_estimate)
    assert "heat" not in plain


def test_what_no_current_is_known_of_is_refused() -> None:
    with pytest.raises(QuantityError, match="jumps by 65 V"):
        ss.steady_steps(KANG, ss.Sawtooth("65 V", "50 Hz"), parameters={"sigma_0": [1e6]}, stack=STACK)
    step = ss.Step("20 V", "1 ms")
    with pytest.raises(QuantityError, match="Step has no period"):
        ss.simulate_ensemble(KANG, step, "10 ms", parameters={"sigma_0": [1e6]}, stack=STACK)
    scaled = {"drive_scale": [0.5]}
    with pytest.raises(QuantityError, match="vary the amplitude"):
        ss.simulate_ensemble(KANG, WALK, parameters=scaled, stack=STACK)
