"""Moves of a mover beside stored ones, and in exported C.

The stored moves were made by the former state machine, which was written in Python, and in C a second time:
both gave the same voltages to the bit. After an intended change of the machine,
``PYTHONPATH=src python tests/control/test_moves_stored.py`` stores the moves of the present one.
"""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from stickslip.control import (
    MoveError,
    Mover,
    Notch,
    Pid,
    Regulator,
    Slip,
    Stepping,
    StepSizes,
    export_mover,
)

FILE = Path(__file__).with_name("moves.json")
RATE, GAIN = 20e3, 0.1e-6
TABLE = StepSizes((10.0, 30.0, 60.0), (0.3e-6, 1.6e-6, 4.1e-6), (0.4e-6, 1.9e-6, 4.6e-6))


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


class Case(NamedTuple):
    """Targets one after the other [m], further targets drawn from within 60 um, the steps wanted at random
    ticks, the tick of every 2500 at which the middle of the range is wanted, the mover, and the slider."""

    targets: tuple[float, ...] = ()
    drawn: int = 0
    jogs: tuple[int, ...] = ()
    centred: int = -1
    ticks: int = 30_000
    amplitude: float = 60.0
    edge: float = 0.0
    low: float = 0.0
    slider: dict[str, float] = {}  # noqa: RUF012
    seed: int = 0

    def mover(self) -> Mover:
        loop = Regulator(
            Pid("500 V/(um*s)"), RATE, notches=(Notch("1 kHz"),), feedforward="10 V/um", min_voltage=self.low
        )
        walk = Stepping(self.amplitude, "400 Hz")
        return Mover(walk, TABLE, loop, GAIN, hold=0.02, slip=Slip(self.edge))


CASES = {
    "near and far": Case(drawn=6, jogs=(3, -2, 5), centred=2400),
    "short steps": Case(drawn=6, jogs=(3, -2, 5), centred=2400, amplitude=30.0, low=-20.0, seed=1),
    "slip edge": Case(drawn=6, jogs=(3, -2, 5), centred=2400, amplitude=47.0, edge=0.13e-3, seed=2),
    "end stop": Case((500e-6,), slider={"stop": 40e-6}, seed=9),
    "range used up": Case((3e-6,), slider={"creep": -3e-10}, seed=3),
    "out of reach": Case((3e-6,), ticks=60_000, slider={"creep": -4e-8}, seed=3),
    "noise": Case((-2.5e-6, 3e-6, 4e-6), ticks=18_000, low=-20.0, slider={"noise": 6e-9}, seed=4),
}


def driven(case: Case) -> tuple[Mover, list[list[float]], list[list[float]]]:
    """The mover, what it was given tick by tick, and what it said: voltage, steps, when it settled, error."""
    random, mover = np.random.default_rng(case.seed), case.mover()
    targets = [
        *case.targets,
        *(random.uniform(-60e-6, 60e-6, case.drawn) * random.choice([1.0, 0.02], case.drawn)),
    ]
    jogs = dict(zip(random.integers(9000, 29_000, len(case.jogs)).tolist(), case.jogs, strict=True))
    given, said, measured, slider = [], [], 0.0, Slider(random, **case.slider)
    for tick in range(case.ticks):
        target, jog = float(targets[tick * len(targets) // case.ticks]), jogs.get(tick, 0)
        if mover.phase == "hold" and tick % 5000 > 3000:  # it goes along, and at the last too fast for that
            target += 30e-9 * math.sin(tick / (60.0 if tick % 5000 < 4800 else 0.4))
        centre = tick % 2500 == case.centred
        given.append([measured, target, float(jog), float(centre)])
        mover.steps_wanted = jog or mover.steps_wanted
        mover.centre_wanted = centre or mover.centre_wanted
        try:
            volts, error = mover.step(measured, target, tick), 0.0
        except MoveError as why:
            volts, error = math.nan, 1.0 if "attempts" in str(why) else 2.0
        settled = -1.0 if mover.settled_at is None else mover.settled_at
        said.append([volts, mover.steps + 1000.0 * mover.lost, settled, error + 10.0 * mover.done])
        if error:
            break
        measured = slider.position(volts)
    return mover, given, said


def told(mover: Mover, said: list[list[float]]) -> dict[str, Any]:
    """What is stored of a move."""
    arrival, volts = mover.arrival, [one[0] for one in said]
    return {
        "history": [[name, round(begin * RATE)] for name, begin in mover.history],
        "settled": sorted({one[2] for one in said}),
        "ended": [*said[-1][1:], float(bool(mover.remark)), sum(one[3] >= 10.0 for one in said)],
        "voltages": [*volts[:-1:499], math.fsum(volts[:-1])],
        "learnt": [mover.steps_of.forward, mover.steps_of.backward],
        "arrival": [1e9 * arrival.offset, 1e9 * arrival.doubt, 1e9 * arrival.noise],
    }


@pytest.mark.filterwarnings("ignore::stickslip.control.ControlWarning")
@pytest.mark.parametrize("name", CASES)
def test_a_move_is_as_stored(name: str) -> None:
    mover, _, said = driven(CASES[name])
    stored = json.loads(FILE.read_text("utf-8"))[name]
    found = told(mover, said)
    assert found["history"] == stored["history"]
    for key in ("settled", "ended", "voltages", "learnt", "arrival"):
        assert found[key] == pytest.approx(stored[key], rel=1e-9, nan_ok=True), key


PROGRAM = """
#include <stdio.h>
#include "mover.h"

int main(void)
{
    mover m;
    regulator loop;
    double in[4], out[4];
    int64_t tick = 0;
    mover_start(&m, &loop);
    while (fread(in, sizeof in, 1, stdin) == 1) { /* measured, target, steps_wanted, centre_wanted */
        if (in[2] != 0.0)
            m.steps_wanted = (int64_t)in[2];
        if (in[3] != 0.0)
            m.centre_wanted = true;
        out[0] = mover_step(&m, &loop, in[0], in[1], tick++);
        out[1] = (double)(m.steps + 1000 * m.lost);
        out[2] = m.settled ? m.settled_at : -1.0;
        out[3] = (double)m.error + 10.0 * (double)m.done;
        fwrite(out, sizeof out, 1, stdout);
    }
    out[0] = mover_size(&m.table, 60.0, 1);
    out[1] = mover_size(&m.table, 60.0, -1);
    fwrite(out, sizeof out, 1, stdout);
    return 0;
}
"""


def in_c(mover: Mover, folder: Path, given: list[list[float]]) -> list[list[float]]:
    """What the exported header says at each tick, and at the end the size of its steps."""
    export_mover(mover, folder / "mover.h")
    (folder / "main.c").write_text(PROGRAM)
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic"]
    subprocess.run(["gcc", *flags, "main.c", "-o", "main", "-lm"], cwd=folder, check=True)
    content = np.array(given).tobytes()
    found = subprocess.run([folder / "main"], input=content, capture_output=True, check=True).stdout
    return np.frombuffer(found).reshape(-1, 4).tolist()


def test_exported_c_gives_the_same_voltages_to_the_bit(tmp_path: Path) -> None:
    """Every number of the plan and the regulator is in the header, and what was learnt goes along."""
    case = CASES["slip edge"]
    mover, given, said = driven(case)
    *found, sizes = in_c(case.mover(), tmp_path, given)
    assert found == said
    learnt = [mover.steps_of.size(60.0, way) for way in (1, -1)]
    assert sizes[:2] == learnt
    assert in_c(mover, tmp_path, [])[0][:2] == learnt


if __name__ == "__main__":
    moves = {name: told(*driven(case)[::2]) for name, case in CASES.items()}
    rows = (f"{json.dumps(name)}: {json.dumps(one)}" for name, one in moves.items())
    FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
