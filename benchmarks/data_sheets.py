"""How often the intervals of `from_data_sheet` hold the truth.

    python -m benchmarks.data_sheets [COUNT [DRAWS [SEED]]]

Actuators are drawn from what a sheet lets expect. Each is simulated, its numbers are written down with an
error within the sheet's tolerance (95 %), and its parameters are looked for in the intervals.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

import stickslip as ss
from stickslip.design.sheet_density import Simulated
from stickslip.design.sheet_priors import NAMES, Expectations, expectations

PRINTED: dict[str, Any] = {"stroke": 17.4e-6, "max_voltage": 150.0, "resonance": 526.0, "mass": 0.1}
MIDDLE: dict[str, Any] = PRINTED | {"step": 1e-5, "stall_force": 0.15}


def main(count: int, draws: int, seed: int = 0) -> None:
    random = np.random.default_rng(seed)
    expected = expectations(ss.design.DataSheet(**MIDDLE))
    simulated = Simulated.of(ss.design.DataSheet(**MIDDLE), expected)
    held = dict.fromkeys(NAMES, 0)
    made = 0
    while made < count:
        truth = expected.values(random.standard_normal((1, len(NAMES))))
        numbers = numbers_of(truth, expected)
        if not all(np.isfinite(one) for one in numbers.values()):
            continue
        stated = {n: v * np.exp(simulated.deviation * random.standard_normal()) for n, v in numbers.items()}
        if stated["step"] > PRINTED["stroke"]:
            continue
        try:
            found = ss.from_data_sheet(
                **PRINTED, **stated, step_frequency=simulated.step_rate, draws=draws, seed=made + 1000 * seed
            )
        except Exception as error:
            print(made, error)
            continue
        made += 1
        for name in NAMES:
            row = found.dataset.sel(parameter=name)
            held[name] += bool(row["low"] <= truth[name][0] <= row["high"])
        print(
            made, found.posterior.message, {name: f"{one}/{made}" for name, one in held.items()}, flush=True
        )


def numbers_of(truth: Mapping[str, np.ndarray], expected: Expectations) -> dict[str, float]:
    """Return what a sheet would print of an actuator: its step, m, and its stall force, N.

    The stall force is interpolated between loads near the printed one, so it is computed again with the one
    found before until it stays the same within 1 %; NaN if it does not.
    """
    numbers = {"step": math.nan, "stall_force": MIDDLE["stall_force"]}
    for _ in range(20):
        sheet = ss.design.DataSheet(**{**MIDDLE, "stall_force": numbers["stall_force"]})
        found = Simulated.of(sheet, expected)
        before, numbers = numbers, {n: float(one[0]) for n, one in found.predicted(truth).items()}
        if not all(np.isfinite(one) for one in numbers.values()):
            return numbers
        if abs(numbers["stall_force"] / before["stall_force"] - 1.0) < 0.01:
            return numbers
    return numbers | {"stall_force": math.nan}


if __name__ == "__main__":
    main(*(int(one) for one in (sys.argv[1:] + ["100", "480"][len(sys.argv) - 1 :])))
