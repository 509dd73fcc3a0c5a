"""A regulator and a mover in C give the same voltages as in Python, to the bit."""

from __future__ import annotations

import copy
import math
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from stickslip.actuator import load_actuator
from stickslip.control import (
    ControlWarning,
    LowPass,
    MoveError,
    Mover,
    Notch,
    Pid,
    PiezoInverse,
    Regulator,
    Slip,
    Stepping,
    StepSizes,
    export_mover,
    export_regulator,
)
from stickslip.units import QuantityError

RATE = 20e3
PROGRAM = """
#include <stdio.h>
#include "regulator.h"

int main(void)
{
    regulator r;
    double in[2], out;
    regulator_begin(&r, 12.5, 1e-6);
    while (fread(in, sizeof in, 1, stdin) == 1) {
        out = regulator_step(&r, in[0], in[1]);
        fwrite(&out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


@pytest.mark.parametrize(
    "made",
    [
        Regulator(
            Pid("500 V/(um*s)", "1 V/um", "100 V*s/m", "3 kHz"),
            RATE,
            notches=(Notch("350 Hz", 0.5, 0.05), Notch(900.0)),
            low_pass=LowPass("2 kHz"),
            feedforward="9.4 V/um",
            lead="0.3 ms",
        ),
        Regulator(Pid("5 kV/(um*s)"), RATE, max_voltage="20 V"),
        *(
            Regulator(Pid("5 kV/(um*s)"), RATE, min_voltage=low, max_voltage=high)
            for low, high in ((-math.inf, math.inf), (-math.inf, "20 V"), ("-20 V", math.inf))
        ),
    ],
)
def test_c_gives_the_same_voltages_to_the_bit(made: Regulator, tmp_path: Path) -> None:
    """Twenty thousand updates of a measured and a wanted position that drive it to the limits that it has."""
    random = np.random.default_rng(0)
    target = 1e-6 + np.cumsum(2e-9 * random.standard_normal(20_000))
    measured = target - np.cumsum(30e-9 * random.standard_normal(20_000))
    made.begin(12.5, 1e-6)
    expected = [
        made.step(*pair, tick)
        for tick, pair in enumerate(zip(measured.tolist(), target.tolist(), strict=True))
    ]
    assert min(expected) == made.low or made.low == -math.inf
    assert max(expected) == made.high or made.high == math.inf
    assert len(set(expected)) > 1000
    assert export_regulator(made, tmp_path / "regulator.h").is_file()
    (tmp_path / "main.c").write_text(PROGRAM)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic"]
    subprocess.run(["gcc", *flags, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    given = np.column_stack([measured, target]).tobytes()
    found = subprocess.run([tmp_path / "main"], input=given, capture_output=True, check=True).stdout
    assert list(struct.unpack(f"{len(expected)}d", found)) == expected


def test_the_inverse_of_a_piezo_is_not_translated(tmp_path: Path) -> None:
    bent = Regulator(Pid(1e8), RATE, feedforward=PiezoInverse(load_actuator("kang2007-hysteresis"), RATE))
    with pytest.raises(QuantityError, match="not translated to C"):
        export_regulator(bent, tmp_path / "regulator.h")


STAGE = """
#include <stdio.h>
#include "mover.h"

int main(void)
{
    mover m;
    double in[4], out[4];
    long tick = 0;
    mover_begin(&m);
    while (fread(in, sizeof in, 1, stdin) == 1) { /* measured, target, steps_wanted, centre_wanted */
        if (in[2] != 0.0)
            m.steps_wanted = (long)in[2];
        if (in[3] != 0.0)
            m.centre_wanted = true;
        out[0] = mover_step(&m, in[0], in[1], tick++);
        out[1] = (double)(m.steps + 1000 * m.lost);
        out[2] = m.settled ? m.settled_at : -1.0;
        out[3] = (double)m.error + 10.0 * (double)m.done;
        fwrite(out, sizeof out, 1, stdout);
    }
    return 0;
}
"""


class Slider:
    """A piezo and an end-effector that sticks below a voltage edge, and is left behind by some of it above;
    with creep [m per tick] and an end stop."""

    def __init__(
        self, random: np.random.Generator, stop: float = 1.0, creep: float = 2e-12, noise: float = 2e-9
    ) -> None:
        self.random, self.stop, self.creep, self.noise = random, stop, creep, noise
        self.volts = self.slipped = self.crept = 0.0
        self.share = random.uniform(0.5, 0.9)

    def position(self, volts: float) -> float:
        change, self.volts = volts - self.volts, volts
        if abs(change) > 2.0:
            self.slipped -= self.share * change * GAIN
        self.crept += self.creep
        where = self.slipped + self.crept + volts * GAIN
        return min(where, self.stop) + self.noise * self.random.standard_normal()


GAIN = 0.1e-6
TABLE = StepSizes((10.0, 30.0, 60.0), (0.3e-6, 1.6e-6, 4.1e-6), (0.4e-6, 1.9e-6, 4.6e-6))


def made_mover(amplitude: float = 60.0, edge: float = 0.0) -> Mover:
    loop = Regulator(Pid("500 V/(um*s)"), RATE, notches=(Notch("1 kHz"),), feedforward="10 V/um")
    return Mover(Stepping(amplitude, "400 Hz"), TABLE, loop, GAIN, hold=0.02, slip=Slip(edge))


def driven(
    mover: Mover, targets: list[float], jogs: dict[int, int], slider: Slider, steps: int, centred: int = 2500
) -> tuple[list[list[float]], list[list[float]]]:
    """What a mover was given tick by tick, and what it said: voltage, steps, when it had settled, error."""
    given, said, measured = [], [], 0.0
    for tick in range(steps):
        target, jog = targets[tick * len(targets) // steps], jogs.get(tick, 0)
        if mover.phase == "hold" and tick % 5000 > 3000:  # it goes along, and at the last too fast for that
            target += 30e-9 * math.sin(tick / (60.0 if tick % 5000 < 4800 else 0.4))
        centre = float(tick % centred == 2400)
        given.append([measured, target, float(jog), centre])
        mover.steps_wanted = jog or mover.steps_wanted
        mover.centre_wanted = bool(centre) or mover.centre_wanted
        try:
            volts = mover.step(measured, target, tick)
        except MoveError as error:
            which = 1.0 if "attempts" in str(error) else 2.0
            said.append([math.nan, mover.steps + 1000.0 * mover.lost, -1.0, which])
            break
        settled = -1.0 if mover.settled_at is None else mover.settled_at
        said.append([volts, mover.steps + 1000.0 * mover.lost, settled, 10.0 * mover.done])
        measured = slider.position(volts)
    return given, said


def in_c(mover: Mover, folder: Path, given: list[list[float]]) -> list[list[float]]:
    export_mover(mover, folder / "mover.h")
    (folder / "main.c").write_text(STAGE)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["gcc", *flags, "main.c", "-o", "main"], cwd=folder, check=True)
    content = np.array(given).tobytes()
    found = subprocess.run([folder / "main"], input=content, capture_output=True, check=True).stdout
    return np.frombuffer(found).reshape(-1, 4).tolist()


@pytest.mark.parametrize("seed", range(2))
def test_a_move_in_c_is_the_same_to_the_bit(seed: int, tmp_path: Path) -> None:
    """Targets near and far either way, jogs and centring; the slider's steps are not those of the table."""
    random = np.random.default_rng(seed)
    targets = (random.uniform(-60e-6, 60e-6, 6) * random.choice([1.0, 0.02], 6)).tolist()
    jogs = {
        int(tick): int(count)
        for tick, count in zip(random.integers(9000, 29_000, 3), (3, -2, 5), strict=True)
    }
    amplitude, edge = ((60.0, 0.0), (30.0, 0.0), (47.0, 0.13e-3), (60.0, 0.2e-3))[seed]
    mover = made_mover(amplitude, edge)
    given, said = driven(mover, targets, jogs, Slider(random), 30_000)
    assert {"return", "step", "wait", "scan", "hold"} <= {phase for phase, _ in mover.history}
    assert {mover.steps_of.forward, mover.steps_of.backward} != {1.0}
    assert mover.steps >= 10
    assert in_c(made_mover(amplitude, edge), tmp_path, given) == said


def test_an_end_stop_in_c(tmp_path: Path) -> None:
    given, said = driven(made_mover(), [500e-6], {}, Slider(np.random.default_rng(9), 40e-6), 30_000)
    assert said[-1][3] == 2.0
    found = in_c(made_mover(), tmp_path, given)
    assert found[:-1] == said[:-1]
    assert found[-1][1:] == said[-1][1:]


def test_a_range_that_holding_uses_up_in_c(tmp_path: Path) -> None:
    """The piezo jumps to the middle of its range when creep has brought it to the end."""
    mover = made_mover()
    given, said = driven(mover, [3e-6], {}, Slider(np.random.default_rng(3), creep=-3e-10), 30_000, 10**6)
    phases = [phase for phase, _ in mover.history]
    assert phases.index("hold") < phases.index("recentre") < len(phases) - 2
    jumps = np.diff([volts for volts, *_ in said])
    assert jumps.min() < -40.0
    assert in_c(made_mover(), tmp_path, given) == said


def test_arrival_in_noise_in_c(tmp_path: Path) -> None:
    mover = made_mover()
    with pytest.warns(ControlWarning, match="more than a third"):
        given, said = driven(mover, [3e-6, 4e-6], {}, Slider(np.random.default_rng(4), noise=6e-9), 12_000)
    assert len({settled for _, _, settled, _ in said if settled >= 0.0}) >= 2, "it settles again"
    assert in_c(made_mover(), tmp_path, given) == said


def test_what_was_learnt_goes_along(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    walked = made_mover()
    driven(walked, [80e-6, -80e-6], {}, Slider(random), 20_000)
    again = made_mover()
    again.steps_of = walked.steps_of
    exported = copy.deepcopy(again)
    given, said = driven(again, [60e-6], {}, Slider(random), 8000)
    assert in_c(exported, tmp_path, given) == said
