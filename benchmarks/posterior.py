"""Time of 1000 likelihoods of a walk, as the posterior asks for them and one after the other.

    python -m benchmarks.posterior [REPETITIONS]

The walk is the thesis's, 65 V and 5 Hz, eight periods there and eight back, 1 kHz: 3.9 s. CPU and wall time,
the least of the repetitions; what else runs on the machine counts in the wall time.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from stickslip.actuator import load_actuator
from stickslip.identify.walk.likelihood import Misfit
from stickslip.identify.walk.position_channel import CHANNEL
from stickslip.simulation import simulate
from stickslip.simulation.varied import with_values
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest

HALF_STEP, LIKELIHOODS, TOLERANCE = 16, 1000, 3e-10


def least(work: Callable[[], int], repetitions: int) -> tuple[float, float]:
    """CPU and wall time [s] of 1000 likelihoods, from work that does some of them and says how many."""
    found = []
    for _ in range(repetitions):
        cpu, wall = time.process_time(), time.perf_counter()
        share = LIKELIHOODS / work()
        found.append((share * (time.process_time() - cpu), share * (time.perf_counter() - wall)))
    return min(f[0] for f in found), min(f[1] for f in found)


def main(repetitions: int) -> None:
    """Measure and print."""
    model = load_actuator("kang2007").replace(stage_reaction=False)
    there, back = Sawtooth(65.0, 5.0, periods=8), ReverseSawtooth(65.0, 5.0, periods=8)
    drive = Sequence(Rest(0.2), there, Rest(0.5), back)
    times = np.arange(3901) * 1e-3
    recording = simulate(model, drive, times=times, tolerance=TOLERANCE)
    misfit = Misfit(recording, drive, None, "walk", model, (1e-3, 2e-5), TOLERANCE)
    random = np.random.default_rng(0)
    values = {
        "sigma_0": 1.399e6 * np.exp(0.03 * random.standard_normal(HALF_STEP)),
        "sigma_1": 34.9 * np.exp(0.3 * random.standard_normal(HALF_STEP)),
        "coulomb_force": 0.5401 * np.exp(0.005 * random.standard_normal(HALF_STEP)),
        "delay": 1e-3 + 1e-5 * random.standard_normal(HALF_STEP),
        "offset": 3e-9 * random.standard_normal(HALF_STEP),
    }

    def together() -> int:
        misfit(values)
        return HALF_STEP

    def one_by_one() -> int:
        for m in range(HALF_STEP):
            own = {n: float(v[m]) for n, v in values.items() if n not in CHANNEL}
            later = np.maximum(times - values["delay"][m], 0.0)
            moving = np.append(0.0, later[later > 0.0])
            simulate(with_values(model, own), drive, times=moving, tolerance=TOLERANCE)
        return HALF_STEP

    for work in (together, one_by_one):  # compiled, cached
        work()
    rows = {"half steps of 16 walkers": together, "a loop over simulate": one_by_one}
    measured = {name: least(work, repetitions) for name, work in rows.items()}
    for name, (cpu, wall) in measured.items():
        print(f"{name}: {cpu:.2f} s CPU, {wall:.2f} s")
    (a, b), (c, d) = measured.values()
    print(f"ratio: {c / a:.1f} in CPU time, {d / b:.1f} in wall time")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
