"""The exported observer: stable in every state of the contact, at every step, and never silently lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from export.building import FLOAT, QUICK, C, compiled, output
from friction.samples import ALL, name
from stickslip.export import ExportError, export_c, gain
from stickslip.export.gain import observer_gain
from stickslip.export.linear import ContactSlopes, Method, contacts
from stickslip.physics.electronics import Amplifier

KANG = ss.load_actuator("kang2007")
MODES = ss.physics.StageModes((1e-8, -4e-9), (7600.0, 10200.0), (0.02, 0.05), (0.4, 2.0))
RANDOM = ("LuGre", "Dahl", "Elastoplastic", "ResetIntegrator", "MaxwellSlip", "Stribeck")


def drawn(law: str, seed: int) -> tuple[ss.Actuator, float]:
    """An actuator with a law of that kind, and a voltage that makes it slide, V."""
    random = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    stage = ss.Actuator(
        gain=between(2e-8, 3e-7),
        natural_frequency=2 * math.pi * between(300, 4000),
        damping_ratio=between(0.02, 0.7),
        stage_mass=between(0.02, 0.5),
        end_effector_mass=between(0.005, 0.3),
        friction=ALL[0],
        stage_reaction=bool(random.random() < 0.6),
    )
    volts = between(30.0, 120.0)
    force = stage.end_effector_mass * between(3.0, 20.0)
    deflection = stage.gain * volts * between(0.01, 0.2)
    stiffness = force / deflection
    damping = 2 * between(0.05, 0.7) * math.sqrt(stiffness * stage.end_effector_mass)
    more = force * between(1.05, 1.8)
    friction = {
        "LuGre": ss.LuGre(stiffness, damping, 0.0, force, more, between(1e-4, 1e-2)),
        "Dahl": ss.Dahl(stiffness, force, (0.5, 1.0, 1.5, 2.0)[seed % 4]),
        "Elastoplastic": ss.Elastoplastic(stiffness, damping, 0.0, force, more, 0.4 * deflection, 1e-3),
        "ResetIntegrator": ss.ResetIntegrator(stiffness, deflection, 0.3, damping),
        "MaxwellSlip": ss.MaxwellSlip((0.6 * stiffness, 0.4 * stiffness), (0.5 * force, 0.5 * force)),
        "Stribeck": ss.Stribeck(force, more, between(1e-3, 1e-2), 0.0),
    }[law]
    return stage.replace(friction=friction), volts


def observing(folder: Any, *flags: str, jump: str = "0") -> list[float]:
    """Rms errors of the estimate and of the samples, m; how often it was lost; its error at the end, m."""
    made = compiled(folder, C / "observing.c", *(flags or ("-O2",)), name=f"observing{len(flags)}")
    return [float(number) for number in output(made, jump).split()]


@pytest.mark.parametrize(
    ("h", "seeds"), [(20e-6, (1, 2)), (100e-6, (3, 4)), (200e-6, (1, 4)), (1e-3, (2, 3))]
)
@pytest.mark.parametrize("law", RANDOM)
def test_an_exact_model_is_not_worse_than_the_sensor(
    law: str, h: float, seeds: tuple[int, int], tmp_path: Any
) -> None:
    """Sliding or sticking, of random actuators."""
    for seed in seeds:
        model, volts = drawn(law, seed)
        drive = ss.Sawtooth(volts, 25.0, periods=10)
        estimate, raw, lost, _ = observing(
            export_c(model, tmp_path / f"{seed}", step=h, waveform=drive, duration=max(0.2, 600 * h))
        )
        assert lost == 0
        assert estimate < (0.7 if h < 50e-6 else 1.1) * raw


@pytest.mark.parametrize("h", [20e-6, 0.8e-3, 3e-3])
@pytest.mark.parametrize("source", ["kang2007", "kang2007-hysteresis"])
def test_the_packaged_actuators(source: str, h: float, tmp_path: Any) -> None:
    periods = 2 if h < 50e-6 else 8
    for k, drive in enumerate(
        (ss.Sawtooth(65.0, 5.0, periods=periods), ss.Sine(30.0, 5.0, offset=30.0, periods=periods))
    ):
        folder = export_c(source, tmp_path / f"{k}", step=h, waveform=drive)
        for flags in ((), FLOAT):
            estimate, raw, lost, _ = observing(folder, *flags)
            assert lost == 0
            assert estimate < (0.5 if h < 50e-6 else 1.1) * raw


@pytest.mark.parametrize("jump", ["nan", "1e-3", "-1e30", "inf"])
@pytest.mark.parametrize("real", ["-O2", "-DSTICKSLIP_FLOAT"])
def test_a_lost_estimate_is_said_and_begun_again(real: str, jump: str, tmp_path: Any) -> None:
    """The stage of kang2007 goes 16 um far."""
    folder = export_c(KANG, tmp_path / "c", waveform=ss.Sine(30.0, 20.0, offset=30.0, periods=4))
    assert observing(folder, "-O2", real)[2] == 0
    _, _, lost, last = observing(folder, "-O2", real, jump=jump)
    assert lost == 1
    assert abs(last) < 30e-9


@pytest.mark.parametrize("jump", ["nan", "1e-3"])
def test_it_is_begun_again_under_the_last_input_of_an_amplifier(jump: str, tmp_path: Any) -> None:
    """Which is not the voltage at the piezo: 15 times as much, and 5 V."""
    amplifier = Amplifier(15.0, 5.0, 8e3, 1e6, 2.0, 0.0, 110.0)
    drive = ss.Sine(2.0, 20.0, offset=3.0, periods=4)
    folder = export_c(KANG, tmp_path / "c", waveform=drive, amplifier=amplifier, piezo_capacitance=5e-7)
    estimate, raw, lost, _ = observing(folder, jump=jump)
    assert lost == 1
    assert estimate < 0.5 * raw


@pytest.mark.parametrize("h", [20e-6, 200e-6, 5e-3])
@pytest.mark.parametrize(
    "model",
    [
        KANG,
        KANG.replace(stage_reaction=False),
        KANG.replace(natural_frequency=math.inf),
        KANG.replace(friction=ss.MaxwellSlip((1e6, 3e5), (0.3, 0.2), 20.0)),
        KANG.replace(friction=ss.Coulomb(0.54)),
        KANG.replace(clamped=True),
    ],
    ids=["LuGre", "no reaction", "static stage", "Maxwell slip", "Coulomb", "clamped"],
)
def test_the_linear_step_is_that_of_the_code(model: ss.Actuator, h: float, tmp_path: Any) -> None:
    """By differences of a step from rest, for a contact that sticks without deflection."""
    folder = export_c(model, tmp_path / "c", step=h)
    program = compiled(folder, C / "linear.c", *QUICK, "-DSTICKSLIP_TOLERANCE=1e-16")
    found = np.array([line.split() for line in output(program, repr(h)).splitlines()], float).T
    scale = np.array([1.0, 1.0 / h, 1.0, 1.0 / h, 1.0])
    parts = slice(4 if isinstance(model.friction, ss.Coulomb) else 5)  # without a bristle
    sticks = contacts(model.friction, h, 1.0)[0][0]._replace(b=0.0)
    expected = Method(model, h).after(sticks)
    off = (found - expected) / scale[:, None] * scale
    assert np.max(np.abs(off[parts, parts])) < 1e-3


@pytest.mark.parametrize("law", ALL, ids=name)
def test_every_law_has_a_gain_from_short_to_long_steps(law: Any) -> None:
    for h in (1e-6, 20e-6, 0.3e-3, 5e-3):
        for stage in ({}, {"natural_frequency": math.inf}, {"further_modes": MODES}):
            found = observer_gain(KANG.replace(friction=law, **stage), h, 10e-9)
            assert found is not None
            assert 0.0 < found[2] <= 1.0


@pytest.mark.parametrize("law", [ss.Coulomb(0.54), ss.Stribeck(0.54, 0.6, 1e-3, 0.0), KANG.friction], ids=str)
@pytest.mark.parametrize("stage", [{}, {"natural_frequency": math.inf}, {"further_modes": MODES}], ids=str)
def test_a_clamped_end_effector_is_part_of_the_stage(law: Any, stage: dict[str, Any], tmp_path: Any) -> None:
    """Of a stage that follows its input there is nothing to correct."""
    model = KANG.replace(friction=law, clamped=True, **stage)
    found = observer_gain(model, 20e-6, 10e-9)
    assert found is not None
    assert found[2] == pytest.approx(found[0] + found[5::2].sum())
    assert (found[2] > 0.0) == ("natural_frequency" not in stage)
    drive = ss.Sawtooth(65.0, 20.0, 0.9, periods=4)
    folder = export_c(model, tmp_path / "c", waveform=drive)
    estimate, raw, lost, _ = observing(folder, *QUICK)
    assert lost == 0
    assert estimate < 0.5 * raw
    made = output(compiled(folder, folder / "host" / "walk.c", *QUICK))
    columns = np.array([line.split(",") for line in made.splitlines()[1:]], float)
    truth = ss.simulate(model, drive, times=columns[:, 0], tolerance=1e-9).end_effector_position.values
    assert columns[:, 2] == pytest.approx(truth, abs=5e-9)


def test_a_step_without_a_stable_gain_is_named(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a contact that throws its errors up by more the longer the step is."""
    wild = ContactSlopes(KANG.friction.sigma_0, -1e4, 1.0, 0.0)
    monkeypatch.setattr(
        gain, "contacts", lambda law, h, mobility: ([ContactSlopes(1e6, 30.0, 1.0), wild], 0.5)
    )
    monkeypatch.setattr(gain, "_RUNS_AWAY", math.inf)
    with pytest.raises(ExportError, match=r"no gain at step = 0\.\d+ s that is stable .*: step = \S+ s does"):
        export_c(KANG, tmp_path / "c", step=1e-3)
    assert not list(tmp_path.iterdir())
