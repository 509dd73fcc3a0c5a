"""CPU time of an effective sample of a walk's posterior: five parameters, delay and offset among them.

    python -m benchmarks.posterior [SEEDS]

The walk is the thesis's, 65 V and 5 Hz, eight periods there and eight back, 1 kHz, 120 nm of noise: 3.9 s.
The least effective number of any parameter counts, in the bulk or the tails; so does all that adapting takes.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from stickslip.identify.walk.bayes import posterior
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import load_actuator
from stickslip.simulation import simulate
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest

NOISE = 120e-9  # m


def main(seeds: int) -> None:
    """Measure and print."""
    model = load_actuator("kang2007").replace(stage_reaction=False)
    there, back = Sawtooth(65.0, 5.0, periods=8), ReverseSawtooth(65.0, 5.0, periods=8)
    drive = Sequence(Rest(0.2), there, Rest(0.5), back)
    recording = simulate(model, drive, times=np.arange(3901) * 1e-3, tolerance=3e-10)
    recording["end_effector_position"] += NOISE * np.random.default_rng(0).standard_normal(3901)
    free = ["sigma_0", "sigma_1", "coulomb_force", "delay", "offset"]
    fit = identify_friction(recording, model, free, drive=drive)
    print(fit.report())
    posterior(fit, recording, drive=drive, max_simulations=200)  # imports
    for seed in range(seeds):
        cpu = time.process_time()
        found = posterior(fit, recording, drive=drive, seed=seed)
        cpu = time.process_time() - cpu
        least = float(found.summary[["ess", "ess_tail"]].to_array().min())
        print(f"seed {seed}: {cpu:.1f} s, {1e3 * cpu / least:.1f} ms an effective sample; {found.message}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 3)
