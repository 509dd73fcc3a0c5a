"""The band of the open-loop position holds the truth as often as it says, and a sensor mends it."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip.control import Estimator, StepModel
from stickslip.physics.actuator import load_actuator
from stickslip.physics.electronics import OutputStage
from stickslip.quantities.units import QuantityError
from stickslip.simulation import steady_step
from stickslip.waveform import Sawtooth

KANG = load_actuator("kang2007")
KNOWN = StepModel(
    forward="3 um",
    backward="2.8 um",
    per_load="-5 um/N",
    scatter="100 nm",
    size_error="3 nm",
    size_drift="0.1 nm",
    load="20 mN",
    load_error="1 mN",
    load_drift="20 uN",
)


def truth(random: np.random.Generator, directions: np.ndarray, of: StepModel = KNOWN) -> np.ndarray:
    """Positions after each step of a motor drawn from the model, by its definition."""
    normal = random.standard_normal
    forward, backward = of.forward + of.size_error * normal(), of.backward + of.size_error * normal()
    load, x, found = of.load + of.load_error * normal(), 0.0, []
    for direction in directions:
        step = forward if direction > 0 else -backward
        x += step + of.per_load * load + of.scatter * normal()
        forward += of.size_drift * normal()
        backward += of.size_drift * normal()
        load += of.load_drift * normal()
        found.append(x)
    return np.array(found)


def test_the_states_are_found_with_a_sensor_and_the_band_still_holds() -> None:
    """60 steps each way with a measurement every fifth: then both steps, as they are under the load, are
    known, and 50 more without one end in the band, whose width is how they scatter."""
    random, unknown = np.random.default_rng(1), KNOWN._replace(scatter=30e-9, size_error=30e-9)
    directions, more, off = np.tile([1] * 10 + [-1] * 10, 6), np.ones(50, dtype=int), []
    for _ in range(40):
        at = truth(random, np.append(directions, more), unknown)
        one = Estimator(unknown)
        for k, direction in enumerate(directions):
            one.stepped(int(direction))
            if k % 5 == 4:
                one.measured(at[k] + 10e-9 * random.standard_normal(), "10 nm")
        assert not one.events
        one.stepped(1, more.size)
        off.append((at[-1] - one.position) / one.error)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(1.0, abs=0.33)  # three standard errors
    blind = Estimator(unknown)
    blind.stepped(1, more.size)
    assert np.ptp(one.band()) < 0.3 * np.ptp(blind.band())


def test_lost_steps_are_noticed() -> None:
    one = Estimator(KNOWN)
    one.stepped(1, 20)
    one.measured(one.position - 6e-6, "10 nm")
    ((steps, words),) = one.events
    assert steps == 20
    assert "off by -6e-06 m" in words
    assert one.position == pytest.approx(20 * (3e-6 - 0.1e-6) - 6e-6, abs=20e-9)


def test_the_steps_of_a_model_and_their_slope_over_the_load() -> None:
    made = StepModel.of_model(KANG, OutputStage(), "65 V", "100 Hz", scatter="30 nm")
    loaded = steady_step(KANG.replace(external_force=-20e-3), Sawtooth("65 V", "100 Hz"))
    assert made.forward + made.per_load * -20e-3 == pytest.approx(loaded, rel=0.01)
    assert made.per_load > 0.0
    assert made.forward == pytest.approx(made.backward, rel=1e-3)
    assert made.scatter == 30e-9


@pytest.mark.parametrize(("scale", "rotary"), [(16.0, False), (100.0, True)])
def test_the_slope_over_the_load_is_that_of_the_actuator_s_own_size(scale: float, rotary: bool) -> None:
    """With all masses and forces so many times smaller the steps are the same, and the slope is larger."""
    of = KANG.friction
    law = of._replace(
        sigma_0=of.sigma_0 / scale,
        sigma_1=of.sigma_1 / scale,
        coulomb_force=of.coulomb_force / scale,
        stiction_force=of.stiction_force / scale,
    )
    small = KANG.replace(
        stage_mass=KANG.stage_mass / scale,
        end_effector_mass=KANG.end_effector_mass / scale,
        friction=law,
        rotary=rotary,
    )
    made, walk, force = (
        StepModel.of_model(small, OutputStage(), 65.0, 100.0),
        Sawtooth(65.0, 100.0),
        1e-3 / scale,
    )
    high, low = (steady_step(small.replace(external_force=f), walk) for f in (force, -force))
    assert made.per_load == pytest.approx((high - low) / (2.0 * force), rel=2e-3)


def test_what_is_refused() -> None:
    one = Estimator(KNOWN)
    for call, words in (
        (lambda: one.stepped(2), "direction = 2"),
        (lambda: one.measured(0.0, 0.0), "noise = 0 m"),
        (lambda: one.stepped(1, -5), "count = -5: it must be a whole number >= 0"),
        (lambda: Estimator(KNOWN, 0.0, -1e-9), "error"),
        (lambda: one.band(1.0), "level = 1"),
    ):
        with pytest.raises(QuantityError, match=words):
            call()
    assert one.steps == 0
    assert one.band() == (0.0, 0.0)
