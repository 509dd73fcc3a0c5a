"""A piezo whose charge feels the stage: its limits, an independent solution, its current."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import step

import reference
import stickslip as ss
from stickslip.parameters.writing import parameter_text
from stickslip.physics.piezo import MaxwellCapacitor, Piezo, PrandtlIshlinskii
from stickslip.quantities.units import QuantityError

KANG = ss.load_actuator("kang2007").replace(stage_reaction=True)
PLAYS = PrandtlIshlinskii((0.0, 3.0, 8.0, 15.0), (0.8, 0.08, 0.08, 0.04))
DRIVE = ss.Sawtooth(65.0, 50.0, rise_fraction=0.95)


def charged(capacitance: float, *, charge_drive: bool = False, **changes: float) -> ss.Actuator:
    port = MaxwellCapacitor.of_plays(PLAYS, capacitance, KANG.gain, KANG.stage_stiffness)
    return KANG.replace(piezo=Piezo(port._replace(charge_drive=charge_drive)), **changes)


def test_a_large_capacitance_leaves_the_plays_on_the_drive() -> None:
    """Then what the stage moves is nothing beside the charge, κ = T²/(k C): 6e-8."""
    found = ss.simulate(charged(0.2), DRIVE, 0.1)
    plain = ss.simulate(KANG.replace(piezo=Piezo(PLAYS)), DRIVE, 0.1)
    np.testing.assert_allclose(found.end_effector_position, plain.end_effector_position, atol=3e-9)


def test_driven_by_charge_it_is_a_stiffer_stage_without_a_loop() -> None:
    one = charged(2e-7, charge_drive=True)
    stiffer = 1.0 + one.coupling
    assert one.coupling == pytest.approx(KANG.drive_force_per_volt**2 / KANG.stage_stiffness / 2e-7)
    root = float(np.sqrt(stiffer))
    same = KANG.replace(
        natural_frequency=KANG.natural_frequency * root, damping_ratio=KANG.damping_ratio / root
    )
    jumps = ss.Sawtooth(65.0, 50.0)
    found, plain = (ss.simulate(a, jumps, 0.1) for a in (one, same))
    np.testing.assert_allclose(found.end_effector_position, plain.end_effector_position, atol=2e-9)
    slow = ss.simulate(one.replace(clamped=True), ss.Sine(30.0, 1.0, offset=30.0), 1.5)
    off = slow.stage_position - KANG.gain * slow.drive_voltage
    assert np.abs(off).max() < 3e-3 * KANG.gain * 60.0  # what the damping leaves behind
    by_voltage = ss.simulate(charged(2e-7, clamped=True), ss.Sine(30.0, 1.0, offset=30.0), 1.5)
    assert (
        np.abs(by_voltage.stage_position - KANG.gain * by_voltage.drive_voltage).max() > 0.02 * KANG.gain * 60
    )
    # The loop is in the voltage then: it returns with another one than it went.
    up, down = (
        slow.sel(time=[1.25, 1.75 - 0.5], method="nearest"),
        slow.sel(time=[1.0, 1.5], method="nearest"),
    )
    assert abs(float(down.piezo_voltage[1] - down.piezo_voltage[0])) > 0.5
    assert up.sizes["time"] == 2


def test_a_clamped_stage_is_that_of_elements_that_slip() -> None:
    """In steps of 0.5 us: charges for which the elements give the voltage, found by bisection."""
    random = np.random.default_rng(0)
    one = charged(float(10 ** random.uniform(-7.3, -6.0)), clamped=True)
    port = one.two_port
    assert port is not None
    drive = ss.Sampled(np.linspace(0.0, 6e-3, 7), np.append(0.0, random.uniform(0.0, 100.0, 6)))
    found = ss.simulate(one, drive, 6e-3, sample_rate=2e5, tolerance=1e-10)
    k, limit, inverse = np.array(port.stiffnesses), np.array(port.breakaways), 1.0 / port.capacitance
    per_volt, m, w, zeta = one.drive_force_per_volt, one.stage_mass, one.natural_frequency, one.damping_ratio
    dt, y, dy, q, v = 5e-7, 0.0, 0.0, 0.0, np.zeros(k.size)
    ys, charges = [0.0], [0.0]
    for t in np.arange(1, 12_001) * dt:
        u = np.interp(t - 0.5 * dt, drive.times, drive.values)
        low, high = q - 1e-5, q + 1e-5
        for _ in range(50):
            middle = 0.5 * (low + high)
            across = np.clip(v + k * (middle - q), -limit, limit).sum() + (middle - per_volt * y) * inverse
            low, high = (middle, high) if across < u else (low, middle)
        v, q = np.clip(v + k * (low - q), -limit, limit), low
        dy += dt * (per_volt * (q - per_volt * y) * inverse / m - 2 * zeta * w * dy - w**2 * y)
        y += dt * dy
        ys.append(y)
        charges.append(q)
    np.testing.assert_allclose(found.stage_position, ys[::10], atol=4e-3 * np.abs(ys).max())
    np.testing.assert_allclose(found.charge, charges[::10], atol=4e-3 * np.abs(charges).max())


def test_charge_is_the_integral_of_the_current() -> None:
    found = ss.simulate(charged(5e-7), DRIVE, 0.03, sample_rate=1e6)
    current = found.current.values
    charge = np.append(0.0, np.cumsum(0.5 * np.diff(found.time) * (current[1:] + current[:-1])))
    # Half a sample of a current that jumps at the corners of the drive.
    off = 0.5e-6 * float(np.abs(np.diff(current)).max())
    np.testing.assert_allclose(charge, found.charge, atol=3.0 * off)


def test_steady_steps_ensembles_and_a_long_walk_agree() -> None:
    one = charged(5e-7)
    step = ss.steady_step(one, DRIVE)
    walk = ss.simulate(one, DRIVE, 1.0, sample_rate=50.0).end_effector_position.values
    assert step == pytest.approx(walk[-1] - walk[-2], abs=2e-9)
    both = ss.simulate_ensemble(one, DRIVE, 0.1, parameters={"coulomb_force": [0.5401, 0.4]})
    alone = ss.simulate(one, DRIVE, 0.1).end_effector_position.values[-1]
    assert float(both.net_displacement[0]) == pytest.approx(alone, abs=2e-9)
    slopes = ss.simulation.sensitivities(one, DRIVE, 0.02, parameters=["sigma_0"])
    value, h = KANG.friction.sigma_0, 1e-3
    laws = [KANG.friction._replace(sigma_0=value * (1.0 + share)) for share in (h, -h)]
    ends = [
        ss.simulate(one.replace(friction=law), DRIVE, 0.02, tolerance=1e-12).end_effector_position.values
        for law in laws
    ]
    expected = (ends[0] - ends[1]) / (2.0 * h * value)
    found = slopes.derivative.sel(parameter="sigma_0").values
    np.testing.assert_allclose(found, expected, atol=0.02 * np.abs(expected).max())
    by = ss.simulation.steady_step_derivatives(one, DRIVE, parameters=["gain"])["gain"]
    steps = [
        ss.steady_step(one.replace(gain=one.gain * (1.0 + s)), DRIVE, tolerance=1e-12) for s in (1e-4, -1e-4)
    ]
    assert by == pytest.approx((steps[0] - steps[1]) / (2e-4 * one.gain), rel=5e-3)


def test_it_rests_under_load_and_goes_on_to_the_last_bit(tmp_path) -> None:
    one = charged(5e-7, external_force=0.2)
    still = ss.simulate(one, ss.Constant(40.0), 0.05)
    assert np.ptp(still.stage_position.values) < 1e-11
    expected = KANG.gain * PLAYS.at_rest(40.0) + 0.2 / KANG.stage_stiffness
    assert float(still.stage_position[0]) == pytest.approx(expected, rel=1e-3)
    # A run whose steps have to be refined goes on as near as it says only.
    whole, first = (ss.simulate(one, DRIVE, t, tolerance="10 nm") for t in (0.1, 0.05))
    rest = ss.simulate(one, DRIVE, 0.05, initial_state=first, tolerance="10 nm")
    np.testing.assert_array_equal(rest.end_effector_position, whole.end_effector_position[50:])
    path = tmp_path / "charged.toml"
    path.write_text(parameter_text(charged(5e-7, charge_drive=True), "Charged", "by hand"), encoding="utf-8")
    assert ss.load_actuator(path).piezo == charged(5e-7, charge_drive=True).piezo


@pytest.mark.parametrize("capacitance", [1e-7])
def test_the_linear_stage_of_a_commanded_charge_rings_as_the_simulation(capacitance: float) -> None:
    model = charged(capacitance, charge_drive=True, clamped=True, damping_ratio=0.02)
    run = ss.simulate(model, ss.Step(10.0), 0.05, sample_rate=1e5)
    stage = model.state_space()
    _, linear = step((stage.a, stage.b, stage.c, stage.d), T=run.time.values)
    np.testing.assert_allclose(run.stage_position.values, 10.0 * linear, atol=2e-3 * 10.0 * model.gain)


def test_the_account_of_a_stack_is_not_that_of_its_charge() -> None:
    run = ss.simulate(charged(1e-6), ss.Sine(30.0, 20.0, offset=40.0), 0.1)
    stack = ss.physics.electronics.Stack(1.3e-6, 0.02, 8.0, 150.0, 30.0, 0.5)
    with pytest.raises(QuantityError, match="charge and current of its own piezo"):
        ss.physics.electronics.electrical(run, stack)
    assert ss.physics.electronics.electrical(run[["drive_voltage"]], stack).peak_current > 0.0


def test_what_cannot_be_is_refused() -> None:
    one = charged(5e-7)
    with pytest.raises(QuantityError, match="infinite current at a jump"):
        ss.simulate(one, ss.Sawtooth(65.0, 50.0), 0.1)
    with pytest.raises(QuantityError, match="infinite current at a jump"):
        ss.steady_step(one, ss.Sawtooth(65.0, 50.0))
    with pytest.raises(QuantityError, match="a stage of one mode"):
        one.replace(natural_frequency=np.inf)
    with pytest.raises(QuantityError, match="without a MaxwellCapacitor"):
        ss.simulate(one, DRIVE, 0.01, energy=True)
    found = ss.steady_step(one, DRIVE)
    assert np.isfinite(found)
    assert reference.maxwell_capacitor_voltage(one.two_port, np.zeros(1), np.zeros(1)) == [0.0]
