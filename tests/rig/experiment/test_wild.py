"""Wild experiment files: each either runs, within the limits, or is refused in words that help."""

from __future__ import annotations

import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stickslip.physics.actuator import load_actuator
from stickslip.quantities.input_file import InputFileError
from stickslip.recording import open_recording
from stickslip.rig import RigError, VirtualRig
from stickslip.rig.experiment import run_experiment
from stickslip.rig.experiment.cells import limits_of
from stickslip.rig.experiment.laboratory import VirtualLaboratory
from stickslip.rig.experiment.running import read_experiment

from rig.experiment.files import SMALL, changed, written  # isort: skip


REFUSED = (
    ("title", None, "title: Field required"),
    ("colour", "red", "there is no field 'colour'"),
    ("rig", {"kind": "magic"}, r"rig\.kind: .*virtual"),
    ("rig.bench", "kang2007-bank", "did you mean 'kang2007-bench'"),
    ("rig.bench", "own.toml", r"own\.toml cannot be read"),
    ("actuator", {"set": "kang"}, "no parameter set 'kang'"),
    ("actuator", {"change": {"gain": "0.1 s/V"}}, "run 'walk', voltage = 35 V.*gain"),
    ("actuator", {"change": {"volume": 11}}, "no field 'volume'"),
    ("actuator", {"friction": {"sigma_0": "-1 N/m"}}, "sigma_0"),
    ("limits", {"max_voltage": "60 V"}, "65 V.*above the greatest voltage of 60 V"),
    ("limits", {"max_slew": "1 V/ms"}, "stop_slew|changes at"),
    ("limits", {"max_duty": 0.1, "max_slew": 1e9}, "away from 0 V"),
    ("channels", {}, "channels"),
    ("channels.end_effector_position.input", "inductiv", "did you mean 'inductive'"),
    ("channels.end_effector_position.calibration", ["kang"], "no calibration 'kang'"),
    ("channels.end_effector_position.calibration", [], "needs a calibration"),
    ("channels.end_effector_position.filter.corner", "20 kHz", "below half the sample rate"),
    ("channels.9", {"input": "drive"}, "channels.9"),
    ("runs.0.name", "../etc", "runs.0.name"),
    ("runs.0.waveform", [], "runs.0.waveform"),
    ("runs.0.waveform.0.shape", "Saw", "shape"),
    ("runs.0.waveform.0.fields.amplitude", "$volts", "did you mean 'voltage'"),
    ("runs.0.waveform.0.fields.height", 1.0, "no field 'height'"),
    ("runs.0.waveform.0.fields.periods", 1e30, "takes up to"),
    ("runs.0.waveform.0.fields.frequency", "1 GHz", "above half the output's update rate"),
    ("runs.0.waveform", [{"shape": "Constant"}, {"shape": "Constant"}], "endless"),
    ("runs.0.waveform", [{"file": "gone.nc"}], "no such file"),
    ("runs.0.waveform", [{}], "either a shape or a file"),
    ("runs.0.capture.length", "40 V", "capture.length"),
    ("runs.0.capture.length", "1 year", "takes up to"),
    ("runs.0.capture.interval", "30 us", "whole multiple"),
    ("runs.0.capture.down_sampling", 5, "either interval or down_sampling"),
    ("runs.0.capture.pre_trigger", "1 s", "pre_trigger"),
    ("runs.0.capture.trigger.signal", "nose", "no channel"),
    ("runs.0.capture.trigger.level", "1 m", "level"),
    ("runs.0.matrix", {"voltage": [], "frequency": [1]}, "matrix.voltage"),
    ("runs.0.matrix", {"voltage": ["35 V", "35V"], "frequency": [50]}, "two recordings would be called"),
    ("runs.0.repeats", 10_000, "more than 10000 recordings"),
    ("save_as", ["xls"], "save_as"),
)  # fmt: skip


def test_refused_with_file_and_field(tmp_path) -> None:
    """In one line, with nothing written."""
    for path, value, message in REFUSED:
        file = written(tmp_path, changed(path, value))
        with pytest.raises(InputFileError, match=f"^{re.escape(str(file))}: [^\n]*$") as caught:
            run_experiment(file, tmp_path / "out")
        assert re.search(message, str(caught.value)), caught.value
        assert not (tmp_path / "out").exists()


def test_what_is_no_experiment_at_all(tmp_path) -> None:
    for text in ("", "- 1", "a: [", "a: &a [*a]", "\0", "title: 2026-13-45", "[" * 5000):
        (file := tmp_path / "x.yaml").write_text(text)
        with pytest.raises(InputFileError, match=r"x\.yaml"):
            run_experiment(file, tmp_path / "out")


number = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-(10**20), 10**20) | st.floats(0, 200)
TEXTS = ["35 V", "65 V", "150 V", "-3 V", "5 Hz", "$voltage", "0.1 s", "x", "", "1e400 V"]
value = number | st.sampled_from(TEXTS)
FIELDS = "amplitude frequency periods offset rise_fraction delay duration phase rate rise_time level "
FIELDS += "start_frequency end_frequency amplitudes frequencies times values period smooth"
SHAPES = "Sawtooth ReverseSawtooth Triangle Cycloid Sine Step Ramp Chirp Rest Constant Multisine Saw "
SHAPES += "PeriodicKnots"
LIMITS = "min_voltage max_voltage max_slew max_duty min_position max_position watchdog stop_slew"
ACTUATOR = "gain natural_frequency damping_ratio end_effector_mass clamped stage_reaction friction name nose"


def some(names: str, values, most: int):
    """Some of the names, with values."""
    return st.dictionaries(st.sampled_from(names.split()), values, max_size=most)


fields = some(FIELDS, value | st.lists(value, max_size=3), 5)
shape = st.sampled_from(SHAPES.split())
wild_part = st.fixed_dictionaries({"shape": shape, "fields": fields}, optional={"duration": value})
tame_part = st.builds(
    lambda name, amplitude, frequency, periods: {
        "shape": name, "fields": {"amplitude": amplitude, "frequency": frequency, "periods": periods}
    },
    st.sampled_from(["Sawtooth", "ReverseSawtooth", "Triangle", "Cycloid"]),
    st.floats(-20, 180), st.floats(20, 500), st.integers(1, 3),
)  # fmt: skip
capture = st.fixed_dictionaries(
    {"length": st.sampled_from(["20 ms", 0.03, 1e9, "-1 s", "x"]) | st.floats(0, 0.05)},
    optional={
        "interval": st.sampled_from(["50 us", 1e-3, 3e-5, 0.0]),
        "down_sampling": st.integers(-1, 30),
        "pre_trigger": st.floats(0, 0.02) | number,
        "trigger": st.fixed_dictionaries(
            {
                "signal": st.sampled_from(["drive_voltage", "end_effector_position", "nose"]),
                "level": value | st.floats(0, 60),
            },
            optional={"edge": st.sampled_from(["rising", "falling", "both"])},
        ),
        "average": st.integers(0, 3),
    },
)
tame_capture = st.builds(
    lambda length, step, before: {"length": length, "down_sampling": step, "pre_trigger": before},
    st.floats(0.01, 0.03), st.integers(1, 20), st.floats(0, 5e-3),
)  # fmt: skip
limits = some(LIMITS, value, 3)
change = some(ACTUATOR, value | st.booleans(), 2)
run = st.fixed_dictionaries(
    {
        "name": st.sampled_from(["a", "b", "../x", "walk"]),
        "waveform": st.lists(tame_part | tame_part | wild_part, min_size=1, max_size=3),
        "capture": tame_capture | capture,
    },
    optional={
        "matrix": st.dictionaries(st.sampled_from(["voltage", "f"]), st.lists(value, max_size=2), max_size=2)
    },
)
experiment = st.fixed_dictionaries(
    {"runs": st.lists(run, min_size=1, max_size=2)},
    optional={"limits": limits, "actuator": st.fixed_dictionaries({"change": change})},
)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(content=experiment)
def test_wild_files_run_within_the_limits_or_are_refused(content, tmp_path_factory, monkeypatch) -> None:
    """The voltages at the piezo are watched where they come out, behind the gate and the amplifier."""
    folder = tmp_path_factory.mktemp("wild")
    rigs: list[VirtualRig] = []
    make = VirtualLaboratory.rig

    def watched(self, actuator, seed, repeats):
        rigs.append(make(self, actuator, seed, repeats))  # type: ignore[arg-type]
        return rigs[-1]

    monkeypatch.setattr(VirtualLaboratory, "rig", watched)
    content = {"title": "wild", "rig": {"kind": "virtual"}, "channels": SMALL["channels"], **content}
    file, message = written(folder, content), "it ran as it should"
    try:
        for one in run_experiment(file, folder):
            assert open_recording(one.path)["time"].size == one.cell.capture.samples
    except (InputFileError, RigError) as error:
        message = str(error)
    assert len(message) > 12
    assert "\n" not in message
    for rig in rigs:
        times, volts = rig.output()
        if times[-1] == 0.0:
            continue
        allowed, step = (
            limits_of(read_experiment(file).limits, load_actuator("kang2007")),
            rig.capabilities.step,
        )
        assert allowed.min_voltage - 0.51 * step <= volts.min()
        assert volts.max() <= allowed.max_voltage + 0.51 * step
        assert abs(volts[-1]) <= step
