"""The exported plant against the solver, over the thesis's campaign and for every law."""

from __future__ import annotations

import io
import math
import re
import subprocess

import numpy as np
import pytest

from export.building import (
    ARM_COMPILERS,
    COMPILERS,
    FLOAT,
    QUICK,
    QUICK_FLOAT,
    SANITIZED,
    C,
    compiled,
    output,
    walk,
)
from friction.samples import ALL, STATIC, name
from stickslip import Actuator, load_actuator, simulate
from stickslip.export import export_c
from stickslip.export.signal_chain import amplifier_after, sensor_after, sensor_output
from stickslip.friction import Coulomb, LuGre, ResetIntegrator
from stickslip.physics import PulledSlider
from stickslip.physics.electronics import StrainGauge, amplifier_output
from stickslip.recording.chain import Chain
from stickslip.rig import load_bench
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth, Sine
from stickslip.waveform.shapes import Ramp, Step

KANG = load_actuator("kang2007")
# Of the end-effector's position in steps of 20 us, m; docs/export.md states it.
STATED = {"double": 0.1e-9, "float": 1e-9}
REAL = {"double": (), "float": FLOAT}


def difference(model, waveform, duration, columns, tolerance=1e-10) -> float:
    """The greatest difference of the end-effector's position from the solver's, m."""
    truth = simulate(model, waveform, duration, sample_rate=1e3, tolerance=tolerance)
    assert np.allclose(columns["time"], truth["time"].values)
    return float(np.max(np.abs(columns["end_effector_position"] - truth["end_effector_position"].values)))


@pytest.mark.parametrize("real", REAL)
@pytest.mark.parametrize(
    ("volts", "hertz", "shape", "reaction"),
    [
        (75, 5, Sawtooth, True),
        (35, 20, Sawtooth, True),
        (65, 20, ReverseSawtooth, True),
        (65, 5, Sawtooth, False),
    ],
)
def test_campaign(volts, hertz, shape, reaction, real, tmp_path) -> None:
    model, drive = KANG.replace(stage_reaction=reaction), shape(volts, hertz, periods=4)
    found = walk(model, tmp_path / "c", *REAL[real], waveform=drive)
    assert difference(model, drive, 4 / hertz, found, 1e-11) < STATED[real]


RESET = next(law for law in ALL if isinstance(law, ResetIntegrator))
# A stiff contact near its breakaway that a jump of the drive breaks loose within a step.
BREAKS = Actuator(
    gain=1.033e-7,
    natural_frequency=1.087e5,
    damping_ratio=0.355,
    stage_mass=0.02,
    end_effector_mass=3.12e-3,
    friction=LuGre(9.6e7, 37.7, 0.036, 0.755, 0.875, 6.06e-4),
    external_force=0.764,
    stage_reaction=False,
)


def test_a_contact_that_breaks_loose_within_a_step(tmp_path) -> None:
    drive = Sawtooth(65.0, 20.0, periods=3)
    found = walk(BREAKS, tmp_path / "c", waveform=drive)
    path = np.abs(np.diff(found["end_effector_position"])).sum()
    assert difference(BREAKS, drive, 0.15, found) < 2e-5 * path


def test_a_jump_between_two_steps_is_said(tmp_path) -> None:
    """It is played over a step."""
    for hertz, says in ((20.0, False), (18.1, True)):
        export_c(KANG, tmp_path / f"{hertz}", waveform=Sawtooth(65.0, hertz, periods=3))
        program = compiled(tmp_path / f"{hertz}", tmp_path / f"{hertz}" / "host" / "walk.c")
        done = subprocess.run([program], capture_output=True, text=True, check=True)
        assert ("jumps between two steps" in done.stderr) == says


def test_a_corner_between_two_steps_is_said_with_its_size(tmp_path) -> None:
    """It is lost: the input is a straight line over each step."""
    drive = Sawtooth(65.0, 80.0, 0.9, periods=3)
    export_c(KANG, tmp_path / "c", waveform=drive)
    program = compiled(tmp_path / "c", tmp_path / "c" / "host" / "walk.c", *QUICK)
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    # The corner is in the middle of a step, where the error is (change of slope) h / 4.
    bend = (65.0 / 0.9 + 65.0 / 0.1) * 80.0 * 20e-6 / 4
    said = re.search(r"within a step of 2e-05 s the waveform differs by up to (\S+) V", done.stderr)
    assert said
    assert float(said[1]) == pytest.approx(bend, rel=0.01)
    found = np.genfromtxt(io.StringIO(done.stdout), delimiter=",", names=True)
    assert STATED["double"] < difference(KANG, drive, 3 / 80, found) < KANG.gain * bend


@pytest.mark.parametrize("law", ALL, ids=name)
def test_every_law(law, tmp_path) -> None:
    model, drive = KANG.replace(friction=law), Sawtooth(65, 20, periods=4)
    for real, flags in (("double", ["-O2"]), ("float", QUICK_FLOAT)):
        found = walk(model, tmp_path / real, *flags, waveform=drive)
        assert difference(model, drive, 0.2, found, 1e-10) < STATED[real]
        output(compiled(tmp_path / real, C / "endure.c", *flags), "4000")


MODELS = {
    "clamped": KANG.replace(clamped=True),
    "loaded": KANG.replace(external_force=0.1, incline=0.05),
    "static stage": KANG.replace(natural_frequency=math.inf),
    "loaded at rest": KANG.replace(friction=Coulomb(0.54), external_force=0.3),
}


@pytest.mark.parametrize("case", MODELS)
def test_models(case, tmp_path) -> None:
    drive = Sawtooth(65, 20, 0.9, periods=4)
    found = walk(MODELS[case], tmp_path / "c", waveform=drive)
    assert difference(MODELS[case], drive, 0.2, found) < STATED["double"]
    truth = simulate(MODELS[case], drive, 0.2, tolerance=1e-10)
    assert found["stage_position"] == pytest.approx(truth["stage_position"].values, abs=1e-10)
    kinks = np.isin(np.arange(201) % 50, (0, 45))  # of the drive, where a force of damping is of one side
    force = truth["friction_force"].values[~kinks]
    assert found["friction_force"][~kinks] == pytest.approx(force, abs=2e-4)  # 0.1 nm of the bristle
    assert found["drive_voltage"][1:-1] == pytest.approx(truth["drive_voltage"].values[1:-1], abs=1e-3)


@pytest.mark.parametrize("law", ALL, ids=name)
@pytest.mark.parametrize("load", [{"external_force": 0.9}, {"external_force": -0.4, "incline": 0.6}], ids=str)
def test_a_load_that_the_contact_cannot_hold(law, load, tmp_path) -> None:
    """It begins with the contact at its bound, and slides away."""
    model, drive = KANG.replace(friction=law, **load), Sawtooth(65, 100, periods=2)
    found = walk(model, tmp_path / "c", waveform=drive)
    away = abs(found["end_effector_position"][-1])
    assert away > 5e-5
    assert difference(model, drive, 0.02, found) < 1e-5 * away


@pytest.mark.parametrize("law", [Coulomb(0.2), LuGre(1e5, 50.0, 0.1, 0.2, 0.2)], ids=["Coulomb", "LuGre"])
def test_pulled_slider(law, tmp_path) -> None:
    slider, pull = PulledSlider(0.1, 200.0, 0.5, law), Ramp(1e-2, unit="m")
    found = walk(slider, tmp_path / "c", waveform=pull, duration=0.5, step=1e-4)
    assert difference(slider, pull, 0.5, found) < 2e-9
    assert np.ptp(found["end_effector_position"]) > 5e-4


def test_rest_is_exact(tmp_path) -> None:
    model = KANG.replace(friction=Coulomb(0.54), external_force=0.3)
    found = walk(model, tmp_path / "c", waveform=Sine(1.0, 5.0, offset=30.0, periods=2))
    sliding = found["stage_position"] - found["end_effector_position"]
    assert np.ptp(found["stage_position"]) > 1e-7
    assert np.max(np.abs(sliding)) < 1e-20


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("real", ["double", "float"])
def test_no_warnings(compiler, real, tmp_path) -> None:
    export_c(load_actuator("kang2007").replace(friction=ALL[-1]), tmp_path / "c", duration=0.2)
    flags = ["-DSTICKSLIP_FLOAT"] if real == "float" else ["-O1"]
    for program in ("walk", "observe", "scan"):
        compiled(tmp_path / "c", tmp_path / "c" / "host" / f"{program}.c", *flags, compiler=compiler)


@pytest.mark.parametrize(
    ("law", "level"), [(STATIC[0], "-O1"), (STATIC[0], "-Os"), (RESET, "-O3"), (ALL[-1], "-O3")], ids=str
)
def test_no_optimisation_level_warns(law, level, tmp_path) -> None:
    """Whether gcc takes a variable as uninitialised depends on the level, and on the law. Other tests compile
    with -O0 and -O2."""
    export_c(KANG.replace(friction=law), tmp_path / "c", duration=0.2)
    compiled(tmp_path / "c", tmp_path / "c" / "host" / "walk.c", level)


# A model whose end-effector is clamped after the export: what init says of it, or where it is after a ramp.
CLAMPS = """
#include <stdio.h>
#include "stickslip.h"
int main(void)
{
    stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    parameters.model.clamped = true;
    const char *wrong = stickslip_init(&plant, &parameters, 1e-3);
    if (wrong != NULL) {
        puts(wrong);
        return 0;
    }
    stickslip_rest(&plant, &state, R(0.0));
    for (int k = 0; k < 50; ++k) {
        (void)stickslip_step_ramp(&plant, &state, (real_t)k, (real_t)(k + 1));
    }
    printf("%.17g\\n", (double)stickslip_read(&plant, &state).end_effector_position);
    return 0;
}
"""


def test_what_moves_may_change_where_the_code_is_compiled_for_it(tmp_path) -> None:
    export_c(KANG, tmp_path / "c")
    main = tmp_path / "main.c"
    main.write_text(CLAMPS, encoding="ascii")
    assert "compile it with -DSTICKSLIP_ANY_LAYOUT=1" in output(compiled(tmp_path / "c", main))
    found = output(compiled(tmp_path / "c", main, *QUICK, "-DSTICKSLIP_ANY_LAYOUT=1"))
    truth = simulate(
        KANG.replace(clamped=True), Ramp(1000.0, rise_time=0.05), times=[0.0, 0.05], tolerance=1e-11
    )
    assert float(found) == pytest.approx(float(truth["end_effector_position"][-1]), abs=1e-12)


def test_a_step_that_is_given_up_is_said(tmp_path) -> None:
    export_c(KANG, tmp_path / "c", waveform=Sawtooth(65.0, 20.0, periods=3))
    program = compiled(tmp_path / "c", tmp_path / "c" / "host" / "walk.c", *QUICK, "-DSTICKSLIP_MOST_TRIES=1")
    done = subprocess.run([program], capture_output=True, text=True, check=True)
    assert "the integrator gave a step up" in done.stderr


@pytest.mark.parametrize("real", ["double", "float"])
def test_sanitizers(real, tmp_path) -> None:
    export_c(KANG, tmp_path / "c", waveform=Sawtooth(65, 20, periods=2))
    flags = [*SANITIZED, *REAL[real][1:]]
    for program in ("walk", "observe", "scan"):
        made = compiled(tmp_path / "c", tmp_path / "c" / "host" / f"{program}.c", *flags)
        assert len(output(made).splitlines()) > 50
    made = compiled(tmp_path / "c", C / "endure.c", *flags)
    output(made, "5000")


# The law, the step in s, and how many steps: about a second's work each.
STIFF = {
    "as it is": (KANG.friction, 20e-6, 300_000),
    "a million times stiffer": (KANG.friction._replace(sigma_0=1.399e12), 20e-6, 50_000),
    "undamped": (LuGre(1.399e9, 0.0, 0.0, 0.54, 0.7), 20e-6, 50_000),
    "long steps": (KANG.friction, 1e-2, 10_000),
}


@pytest.mark.parametrize("case", STIFF)
@pytest.mark.parametrize("real", ["double", "float"])
def test_random_input_stays_bounded(case, real, tmp_path) -> None:
    law, h, steps = STIFF[case]
    export_c(KANG.replace(friction=law), tmp_path / "c", duration=0.2)
    made = compiled(tmp_path / "c", C / "endure.c", *REAL[real])
    force, velocity, stage = map(float, output(made, str(steps), repr(h)).split())
    assert 1e-3 < force < 60.0
    assert velocity < 2.0
    assert stage < 3 * KANG.gain * 150


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_long_rest_ends_in_no_nan(real, tmp_path) -> None:
    """Speeds fall until they are too small for their numbers."""
    law = LuGre(2.4e6, 101.5, 0.0, 0.067, 0.067)
    model = KANG.replace(natural_frequency=3481.0, damping_ratio=0.345, end_effector_mass=9e-3, friction=law)
    drive = Sine(34.0, 14.3, offset=48.0, periods=4)
    step = drive.duration / 1399  # 0.2 ms; the corner at the end of the drive is at the end of a step
    found = walk(model, tmp_path / "c", *REAL[real], waveform=drive, duration=2.0, step=step)
    late = found["end_effector_position"][found["time"] > 1.0]
    assert np.ptp(late) < 1e-9
    assert abs(late[0]) > 1e-6


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_late_channel(real, tmp_path) -> None:
    """Within its steps; a delay that was made longer than what is kept is refused."""
    chain = Chain(delay=45e-6, scale=1.02)
    export_c(KANG, tmp_path / "c", waveform=Sine(30.0, 20.0, offset=30.0, periods=2), chain=chain)
    main = tmp_path / "main.c"
    main.write_text(LATE, encoding="ascii")
    program = compiled(tmp_path / "c", main, *SANITIZED, *(REAL[real][1:]))
    for h in (1e-6, 10e-6, 20e-6, 45e-6, 1e-4):
        off, moved = map(float, output(program, repr(h), "45e-6").split())
        assert off < 1e-9 < 1e-7 < moved
    assert output(program, "1e-2", "45e-6").split()[0] != "nan"
    assert "export with this delay" in output(program, "20e-6", "61e-6")


# The channel after a long ramp of the input, which the end-effector follows at constant speed.
LATE = """
#include <stdio.h>
#include <stdlib.h>
#include "stickslip.h"
int main(int count, char **arguments)
{
    stickslip_parameters parameters = stickslip_default_parameters();
    stickslip_plant plant;
    stickslip_state state;
    const double h = atof(arguments[count - 2]), rate = 1000.0;
    parameters.chain.sensor.delay = (real_t)atof(arguments[count - 1]);
    const char *wrong = stickslip_init(&plant, &parameters, h);
    if (wrong != NULL) {
        puts(wrong);
        return 0;
    }
    stickslip_rest(&plant, &state, R(0.0));
    const long steps = (long)(0.02 / h);
    for (long k = 0; k < steps; ++k) {
        const double begin = rate * h * (double)k, end = begin + rate * h;
        (void)stickslip_step_ramp(&plant, &state, (real_t)begin, (real_t)end);
    }
    const stickslip_outputs out = stickslip_read(&plant, &state);
    const double speed = rate * (double)parameters.model.gain;
    const double expected = 1.02 * ((double)out.end_effector_position - speed * 45e-6);
    printf("%.9g %.9g\\n", fabs((double)out.sensor_output - expected), (double)out.end_effector_position);
    return 0;
}
"""


HOST = """
gcc -std=c99 -O2 -ffreestanding -ffunction-sections -DSTICKSLIP_FLOAT -I. -r -o bare.o stickslip.c \
    stickslip_parameters.c && size bare.o
"""


# Where its compiler is not there, the core alone as objects of this machine, whose sizes are alike.
@pytest.mark.parametrize("build", [*("make --no-print-directory bare" for _ in ARM_COMPILERS), HOST])
def test_microcontroller(build, tmp_path) -> None:
    export_c(KANG, tmp_path / "c")
    done = subprocess.run(build, shell=True, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    text, data, bss = map(int, done.stdout.splitlines()[-1].split()[:3])
    assert text + data < 32_000
    assert data + bss < 2_000


@pytest.mark.parametrize("output_resistance", [0.0, 60.0])
def test_amplifier_is_that_of_the_electronics(tmp_path, output_resistance: float) -> None:
    bench, h = load_bench("kang2007-bench"), 20e-6
    bench = bench.replace(amplifier=bench.amplifier._replace(output_resistance=output_resistance))
    volts = np.concatenate([np.zeros(5), np.full(40, 4.0), np.linspace(4.0, 1.0, 30)])
    times, expected = amplifier_output(bench.amplifier, volts, 1 / h, bench.piezo_capacitance)
    now, found = float(expected[0]), []
    for wanted in volts:
        now = amplifier_after(bench.amplifier, bench.piezo_capacitance, float(wanted), now, h)
        found.append(now)
    points = np.interp((np.arange(volts.size) + 1) * h, times, expected)
    assert found == pytest.approx(points, abs=0.02)
    assert np.ptp(points) > 20.0

    sensor = StrainGauge(-22.08e-6, 0.0853, bandwidth=1e3)
    seen = 0.0
    for _ in range(50):
        seen = sensor_after(sensor, 1e-6, seen, h)
    assert seen == pytest.approx(1e-6 * (1 - math.exp(-2 * math.pi * 1e3 * 50 * h)))
    assert sensor_output(sensor, 22.08e-6) == pytest.approx(-1.0 - 0.0853)
    export_c(
        KANG, tmp_path / "c", waveform=Step(3.0, delay=1e-3), duration=0.02, amplifier=bench.amplifier,
        piezo_capacitance=bench.piezo_capacitance, sensor=sensor,
    )  # fmt: skip
    program = compiled(tmp_path / "c", tmp_path / "c" / "host" / "walk.c")
    last = output(program).splitlines()[-1].split(",")
    target = bench.amplifier.gain * 3.0 + bench.amplifier.offset
    assert float(last[1]) == pytest.approx(target, rel=1e-6)
    assert float(last[2]) == pytest.approx(KANG.gain * target, rel=1e-3)
