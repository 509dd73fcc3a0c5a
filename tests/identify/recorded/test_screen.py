"""The screen before every search: sign, size, swapped columns, noise; and random healthy recordings."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from identify.step_system import step_recording
from stickslip.identify.events.pulled import PulledRig, identify_pulled_slider
from stickslip.identify.loops.inertia import identify_inertia
from stickslip.identify.recorded.screen import PositionUnderDrive, refuse_loop, refuse_noise, refuse_walk
from stickslip.recording import RecordingError, make_recording
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth

MODEL = ss.load_actuator("kang2007").replace(stage_reaction=False)
DRIVE = Sawtooth(65.0, 10.0, periods=5)
Array = np.ndarray


def walk(random: np.random.Generator, noise: float = 1e-3, drive: Any = DRIVE) -> tuple[Array, Array, Array]:
    """Time, drive and position of a contact that sticks while the drive is slow and slips at its edges."""
    time = np.arange(0.0, 0.5, 1.0 / float(np.exp(random.uniform(np.log(300.0), np.log(2e4)))))
    u = drive.value(time)
    edge = np.where(np.abs(np.diff(u, prepend=0.0)) > 0.2 * np.ptp(u), np.diff(u, prepend=0.0), 0.0)
    x = MODEL.gain * (u - random.uniform(0.2, 0.9) * np.cumsum(edge))
    x = x + noise * float(np.ptp(x)) * random.standard_normal(x.size)
    return time, u, x


def loop(
    random: np.random.Generator, noise: float = 1e-2, amplitude: float = 20e-6
) -> tuple[Array, Array, Array]:
    """Time, position and force of a bristle under a modulated sine."""
    time = np.arange(2000) * 1e-3
    x = amplitude * np.sin(2.0 * np.pi * time) * (1.0 + 0.3 * np.sin(1.9 * time)) + random.uniform(0.0, 1e-3)
    force, z = np.empty(x.size), 0.0
    for i, dx in enumerate(np.diff(x, prepend=x[0])):
        z = float(np.clip(z + dx, -1e-6, 1e-6))
        force[i] = 3e5 * z
    return time, x, force + random.uniform(-0.3, 0.3) + noise * 0.3 * random.standard_normal(x.size)


SPOILT: dict[str, Callable[[Array, Array], tuple[Array, Array]]] = {
    "sign": lambda x, u: (-x, u),
    "1e3": lambda x, u: (1e3 * x, u),
    "1e-3": lambda x, u: (1e-3 * x, u),
    "1e6": lambda x, u: (1e6 * x, u),
    "1e-6": lambda x, u: (1e-6 * x, u),
    "swapped": lambda x, u: (u, x),
    "noise": lambda x, u: (2e-8 * np.random.default_rng(1).standard_normal(x.size), u),
}
WALKS = {
    "sign": "goes down where drive_voltage .* units: ",
    "1e3": "moves the stage by at most .* a unit",
    "1e-3": "its drive moves the stage by .* a unit",
    "1e6": "moves the stage by at most .* a unit",
    "1e-6": "its drive moves the stage by .* a unit",
    "swapped": "columns are swapped",
    "noise": "nothing but noise",
}


@pytest.mark.parametrize("kind", WALKS)
def test_a_walk_is_refused_before_any_search(kind: str) -> None:
    random = np.random.default_rng(0)
    time, u, x = walk(random)
    x, u = SPOILT[kind](x, u)
    one = make_recording(time, {"end_effector_position": x, "drive_voltage": u})
    with pytest.raises(RecordingError, match=WALKS[kind]):
        ss.identify_friction(one, MODEL, ["sigma_0"], drive=None if kind == "swapped" else DRIVE)


@pytest.mark.parametrize(
    ("kind", "said"), [("sign", "flip|Flip"), ("swapped", "swapped"), ("noise", "noise")]
)
def test_a_loop_is_refused_before_any_search(kind: str, said: str) -> None:
    time, x, force = loop(np.random.default_rng(2))
    force, x = SPOILT[kind](force, x)
    one = make_recording(time, {"position": x, "friction_force": force})
    with pytest.raises(RecordingError, match=said):
        ss.identify_loops(one, ss.Dahl(3e5, 0.3), ["sigma_0"])
    with pytest.raises(RecordingError, match=said):
        identify_inertia(one, window=0.1, force="friction_force")


@pytest.mark.parametrize("factor", [1e3, 1e6])
def test_a_force_of_another_size_than_the_start_is_said(factor: float) -> None:
    time, x, force = loop(np.random.default_rng(3))
    one = make_recording(time, {"position": x, "friction_force": factor * force})
    fit = ss.identify_loops(one, ss.Dahl(3e5, 0.3), ["sigma_0", "coulomb_force", "bias"])
    assert any("are the units of force and position right?" in remark for remark in fit.remarks)


@pytest.mark.parametrize(("kind", "said"), [("swapped", "swapped"), ("noise", "nothing but noise")])
def test_steps_and_piezos_are_refused(kind: str, said: str) -> None:
    step = step_recording(60.0, 1e-8)
    x, u = SPOILT[kind](step["end_effector_position"].values, step["drive_voltage"].values)
    one = make_recording(step["time"].values, {"end_effector_position": x, "drive_voltage": u})
    with pytest.raises(RecordingError, match=said):
        ss.identify_step(one)
    time = np.arange(2000) * 1e-2
    x, u = SPOILT[kind](1e-7 * (50.0 - 50.0 * np.cos(time)), 50.0 - 50.0 * np.cos(time - 0.05))
    with pytest.raises(RecordingError, match=said):
        ss.identify_piezo(make_recording(time, {"stage_position": x, "drive_voltage": u}))


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_a_gain_far_from_the_model_s_is_said(factor: float) -> None:
    step = step_recording(60.0, 1e-8)
    x, u = factor * step["end_effector_position"].values, step["drive_voltage"].values
    fit = ss.identify_step(
        make_recording(step["time"].values, {"end_effector_position": x, "drive_voltage": u}), MODEL
    )
    assert any("are the units right?" in remark for remark in fit.remarks)


@pytest.mark.parametrize("factor", [1e-3, 1e6])
def test_a_pulled_slider_whose_force_has_another_size(factor: float) -> None:
    """The spring adds 0.05 a second."""
    rig = PulledRig(0.1, 50.0, 1e-3)
    time = np.arange(80000) * 1e-3
    ramp = 0.3 + 0.05 * (time % 4.0)
    one = xr.Dataset({"force_ratio": ("time", factor * ramp)}, {"time": time})
    with pytest.raises(RecordingError, match="the unit of the force, the mass, the stiffness or the speed"):
        identify_pulled_slider(one, rig)


def test_random_healthy_recordings_pass() -> None:
    """Small motion, coarse converters, an offset, noise up to a quarter of the motion, a gain that is off."""
    for seed in range(12):
        random = np.random.default_rng(seed)
        drive = (Sawtooth if seed % 2 else ReverseSawtooth)(random.uniform(5.0, 100.0), 10.0, periods=5)
        time, u, x = walk(random, float(np.exp(random.uniform(np.log(1e-4), np.log(0.25)))), drive)
        x = x + random.uniform(-5e-6, 5e-6)
        if seed % 3 == 0:
            step = float(np.ptp(x)) / random.choice([4, 30, 300])
            x = step * np.round(x / step)
        model = MODEL.replace(gain=MODEL.gain * float(np.exp(random.uniform(-1.0, 1.0))))
        refuse_walk(PositionUnderDrive("walk", "end_effector_position", "m", time, x, u), model)
        amplitude = float(np.exp(random.uniform(np.log(5e-7), np.log(1e-3))))  # half a bristle's, and more
        _, x, force = loop(random, float(np.exp(random.uniform(np.log(1e-4), np.log(0.3)))), amplitude)
        refuse_loop(x, force, "loop", ("position", "friction_force"))


def test_white_noise_hardly_ever_passes() -> None:
    passed = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        values = random.standard_normal(int(random.integers(64, 5000)))
        values = np.round(values * 2.0) if seed % 2 else values
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                refuse_noise(values, "position", "noise")
            except RecordingError:
                continue
        passed += 1
    assert passed == 0
