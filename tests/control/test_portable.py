"""A regulator in C gives the same voltages as in Python, to the bit; for a mover see `test_moves_stored`."""

from __future__ import annotations

import math
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from stickslip.control import (
    LowPass,
    Notch,
    Pid,
    PiezoInverse,
    Regulator,
    export_regulator,
)
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.units import QuantityError

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
