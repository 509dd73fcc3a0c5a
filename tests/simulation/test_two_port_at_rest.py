"""A two-port piezo at rest: forces in balance, and the charge at which the elements give the voltage."""

from __future__ import annotations

import numpy as np
import pytest

import plants
import reference
import stickslip as ss
from stickslip.physics.piezo import MaxwellCapacitor, Piezo
from stickslip.simulation import two_port
from stickslip.simulation.models import RelativeLoad
from stickslip.simulation.plant.system import state_size
from stickslip.waveform.drive import constant

KANG = ss.load_actuator("kang2007").replace(stage_reaction=True)


@pytest.mark.parametrize("seed", range(8))
def test_nothing_moves_and_the_elements_give_the_voltage(seed: int) -> None:
    """T (q - T y)/C_0 + load = k y for the charge that is said, and the voltage over elements and ceramic."""
    random = np.random.default_rng(seed)
    count = int(random.integers(1, 4))
    charge = np.cumsum(10 ** random.uniform(-6.5, -4.7, count))
    stiffness = random.uniform(2e4, 2e5, count)
    port = MaxwellCapacitor(
        float(10 ** random.uniform(-7.0, -6.0)), tuple(stiffness), tuple(stiffness * charge), bool(seed % 2)
    )
    clamped = seed % 4 == 3
    load = 0.0 if clamped else float(random.uniform(-0.4, 0.4))
    one = KANG.replace(piezo=Piezo(port), external_force=load, clamped=clamped)
    volts = float(random.uniform(-60.0, 100.0))
    of = RelativeLoad().system(one)
    q = RelativeLoad().rest(of, volts)
    still = plants.motion(of.plant, (1.0, 1.0), q, (volts, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0))[0]
    assert np.abs(still).max() < 1e-9 * KANG.natural_frequency**2 * KANG.gain * 100.0

    y = q[0]
    found = two_port.electrical(one, np.array([[y, 0.0]]), q[None, of.inner :], constant(volts), np.zeros(1))
    asked, (current,) = float(found["charge"][0][0]), found["current"][0]
    per_volt, free = one.drive_force_per_volt, port.capacitance
    ceramic = (asked - per_volt * y) / free
    assert per_volt * ceramic + load == pytest.approx(one.stage_stiffness * y, rel=1e-9)
    across = reference.maxwell_capacitor_voltage(port, np.array([asked]), np.array([asked / free]))[0]
    assert current == 0.0
    if port.charge_drive:
        assert asked == pytest.approx((free + one.gain * per_volt) * volts, rel=1e-12)
        assert float(found["piezo_voltage"][0][0]) == pytest.approx(across + ceramic, rel=1e-9)
    else:
        assert across + ceramic == pytest.approx(volts, rel=1e-9)


def test_stops_are_the_last_element_of_any_plant() -> None:
    """An element over three modes, and the same rest where no other element is there."""
    one = KANG.replace(piezo=Piezo(MaxwellCapacitor(3e-7, (5e4, 9e4, 7e4), (0.2, 0.9, 1.4))))
    element = two_port.element_of(one, 3)
    assert element is not None
    assert (len(element.velocity), len(element.push)) == (3, 3)
    of = RelativeLoad().system(one)
    alone = of.plant._replace(elements=of.plant.elements[-1:])
    both = np.zeros((2, state_size(of.plant)))
    two_port.settle(of.plant, both[0], of.inner, 40.0)
    two_port.settle(alone, both[1], of.inner, 40.0)
    np.testing.assert_array_equal(*both)
    assert both[0, 0] != 0.0


def test_a_charge_that_jumps_finds_the_elements_as_the_rest_before_left_them() -> None:
    port = MaxwellCapacitor(3e-7, (5e4, 9e4, 7e4), (0.2, 0.9, 1.4), True)
    one = KANG.replace(piezo=Piezo(port))
    table, total = (
        constant(20.0)._replace(before=60.0),
        port.capacitance + one.gain * one.drive_force_per_volt,
    )
    found = two_port.electrical(one, np.zeros((1, 2)), np.zeros((1, 0)), table, np.zeros(1))
    charge = total * np.array([60.0, 20.0])
    expected = reference.maxwell_capacitor_voltage(port, charge, np.zeros(2))[1]
    assert float(found["piezo_voltage"][0][0]) == pytest.approx(expected, rel=1e-9)
    assert expected != pytest.approx(reference.maxwell_capacitor_voltage(port, charge[1:], np.zeros(1))[0])
