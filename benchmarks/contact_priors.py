"""Do intervals hold that were made with a prior from a contact? Random truths, near it and far off.

The rig, prior and walk of the page docs/gallery/contact-prior.md. Truths of two kinds: drawn from the prior,
of which 95 % intervals must hold 95 %; and on a ring two to four of its standard deviations off, as of films,
dirt or a soft holder. Each is fitted without the prior and with it.

    python -m benchmarks.contact_priors [COUNT]
"""

from __future__ import annotations

import math
import sys

import numpy as np

import stickslip as ss
from stickslip.estimate import prior_influence
from stickslip.physics.contact import load_pair, rough_prior, self_affine
from stickslip.rig.bench import Mounted

FREE = ("sigma_0", "coulomb_force")
NOISE = 0.38e-6  # m rms, of the sensor at 2 kHz
WALK = ss.Sawtooth(65.0, 50.0, periods=2)
DRIVE = ss.waveform.Sequence(ss.waveform.Rest(0.01), WALK)


def rig_of(prior: ss.physics.contact.ContactPrior):
    """What records two periods with a poor sensor, of a contact; and what is fitted to them."""
    bench = ss.rig.load_bench("kang2007-bench")
    sensor = Mounted(ss.physics.electronics.Interferometer(1e-9, noise_density=2e-9), "end_effector", None)
    bench = bench.replace(sensors={**bench.sensors, "poor": sensor})
    start = ss.load_actuator("kang2007").replace(friction=prior.law(sigma_1=30.0))
    channels = {"drive_voltage": ss.rig.Channel("drive"), "end_effector_position": ss.rig.Channel("poor")}
    capture = ss.rig.Capture(length=0.06, interval=0.5e-3, pre_trigger=0.01)
    drive = ss.physics.electronics.driven(bench.amplifier, DRIVE, bench.piezo_capacitance, 0.06)

    def recorded(truth: dict[str, float], seed: int):
        law = start.friction._replace(**truth, stiction_force=truth["coulomb_force"])
        rig = ss.rig.VirtualRig(start.replace(friction=law), bench, seed=seed)
        return ss.rig.measure(rig, WALK, channels, capture, ss.rig.Limits(max_voltage=100.0))

    def fitted(recording, priors):
        return ss.identify_friction(
            recording, start, list(FREE), priors=priors, noise=NOISE, channel=("delay",), hops=1, drive=drive
        )

    return recorded, fitted


def truths_of(prior: ss.physics.contact.ContactPrior, count: int, far: bool) -> list[dict[str, float]]:
    """Drawn from the prior, or two to four of its standard deviations off in any direction."""
    random = np.random.default_rng(21 + far)
    off = random.standard_normal((count, 2))
    if far:
        off *= (random.uniform(2.0, 4.0, count) / np.hypot(*off.T))[:, None]
    known = [prior.known[name] for name in FREE]
    truths = np.array([of.value * of.factor**column for of, column in zip(known, off.T, strict=True)]).T
    return [dict(zip(FREE, row, strict=True)) for row in truths.tolist()]


def main(count: int) -> None:
    surface = self_affine(0.6e-6, 0.8, longest=128e-6, shortest=2e-6, roll_off=20e-6)
    prior = rough_prior(load_pair("brass-aluminium"), 1.39, surface, 4e-6)
    print(prior.report())
    recorded, fitted = rig_of(prior)
    for kind in ("of the prior", "far off"):
        held = {name: {"without": 0, "with": 0} for name in FREE}
        widths: dict[str, list[float]] = {name: [] for name in FREE}
        noticed = by_held = worse = 0
        for seed, truth in enumerate(truths_of(prior, count, kind == "far off")):
            recording = recorded(truth, seed)
            alone, helped = fitted(recording, None), fitted(recording, prior.priors())
            ends = {"without": alone.confidence_intervals(), "with": helped.confidence_intervals()}
            for name in FREE:
                for how, one in ends.items():
                    held[name][how] += one[name][0] <= truth[name] <= one[name][1]
                wide = {how: math.log(one[name][1] / one[name][0]) for how, one in ends.items()}
                widths[name].append(wide["with"] / wide["without"])
            noticed += any(one.disagrees for one in prior_influence(alone, helped))
            by_held += any(abs(off) > 1.96 for off in prior.held(alone).values())
            error = {
                how: math.hypot(*(math.log(fit.values[n] / truth[n]) for n in FREE))
                for how, fit in (("without", alone), ("with", helped))
            }
            worse += error["with"] > error["without"]
            shown = {
                n: [f"{truth[n]:.3g}", f"{alone.values[n]:.3g}", f"{helped.values[n]:.3g}"] for n in FREE
            }
            print(kind, seed, shown, flush=True)
        print(f"{kind}: of {count}, intervals of 95 % that hold the truth: {held}")
        print({name: f"width with over without, median {np.median(w):.2f}" for name, w in widths.items()})
        print(f"recordings and prior disagree: {noticed}; prior.held beyond 1.96: {by_held}")
        print(f"further off with the prior: {worse}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
