"""Arguments of an export of another kind, or of which no observer comes: named, and nothing written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip import Constant, Sine, load_actuator
from stickslip.export import ExportError, export_c, export_fmu
from stickslip.physics.actuator import PulledSlider
from stickslip.quantities.units import QuantityError
from stickslip.recording.chain import Chain
from stickslip.rig import load_bench

KANG = load_actuator("kang2007")
PULLED = PulledSlider(0.1, 1e4, 1.0, KANG.friction)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"chain": 3}, "chain = 3 must be Chain"),
        ({"sensor": 3}, "sensor = 3 must be StrainGauge"),
        ({"amplifier": 3, "piezo_capacitance": 1e-6}, "amplifier = 3 must be Amplifier"),
        ({"piezo_capacitance": -1.0}, "piezo_capacitance = -1 F must be > 0 F and finite"),
        ({"piezo_capacitance": float("nan")}, "piezo_capacitance = nan F"),
        ({"measurement_noise": float("inf")}, "measurement_noise = inf m must be > 0 m and finite"),
    ],
)
def test_arguments_of_another_kind(given: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(QuantityError, match=said):
        export_c(KANG, tmp_path / "c", **given)
    with pytest.raises(QuantityError, match=said):
        export_fmu(KANG, tmp_path / "fmu", compiler="", **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"chain": Chain(1e-4, slew_rate=1e5)}, r"Chain\.slew_rate = 100000 V/s .* give the chain without"),
        (
            {"amplifier": load_bench("kang2007-bench").amplifier, "piezo_capacitance": 1e-6},
            "a PulledSlider has no drive voltage: export it without an amplifier",
        ),
    ],
)
def test_a_pulled_slider_has_no_drive_voltage(given: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(QuantityError, match=said):
        export_c(PULLED, tmp_path / "c", **given)
    with pytest.raises(QuantityError, match=said):
        export_fmu(PULLED, tmp_path / "fmu", compiler="", **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"motion": 3}, "the wanted motion is in m; motion = 3 is not"),
        ({"motion": np.zeros(4)}, "the wanted motion is in m; motion = array"),
        ({"waveform": 3}, "waveform = 3 is no waveform, such as Sawtooth"),
        ({"waveform": np.zeros(4)}, "waveform = array.* is no waveform"),
        (
            {"motion": Sine(1e-6, 1e7, unit="m")},
            "motion = Sine.*: its duration = 8e-07 s must be finite and at",
        ),
        (
            {"waveform": Constant(30.0)},
            "waveform = Constant.*: its duration = inf s must be finite and at least",
        ),
        ({"waveform": Constant(30.0), "duration": 1e-6}, "^duration = 1e-06 s must be finite and at least"),
    ],
)
def test_what_is_no_waveform_or_shorter_than_a_step(given: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(QuantityError, match=said):
        export_c(KANG, tmp_path / "c", **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"fmi": [2]}, r"fmi = \[2\]: known are versions 2 and 3"),
        ({"compiler": 3}, "compiler = 3 is no command, such as 'gcc'"),
        ({"compiler": None}, "compiler = None is no command"),
    ],
)
def test_what_makes_no_fmu(given: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=said):
        export_fmu(KANG, tmp_path / "fmu", **given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("model", "options", "said"),
    [
        (KANG.replace(end_effector_mass=1e-30), {}, "step = 2e-05 s, end_effector_mass = 1e-30 kg and"),
        (KANG.replace(end_effector_mass=1e-300), {}, "end_effector_mass = 1e-300 kg"),
        (KANG, {"measurement_noise": 1e-200}, "measurement_noise = 1e-200 m"),
        (PULLED._replace(mass=1e-300), {}, "step = 2e-05 s, mass = 1e-300 kg"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_has_no_observer_s_gain(model: Any, options: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=f"the observer has no gain at .*{said}"):
        export_c(model, tmp_path / "c", **options)
    assert not list(tmp_path.iterdir())
