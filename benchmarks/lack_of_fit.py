"""How often a model that is wrong is said to be, and how often one that is right.

Campaigns of `benchmarks.coverage`, with a law of the truth's own: ``python -m benchmarks.lack_of_fit 25``;
names of laws behind the number choose among them, `--first` the first campaign.
All are fitted as there, the stage to three steps and plain LuGre to one walk, and judged on three more walks
too, by what a campaign asks of all walks at once. Three things are said of each:

* `off`: how far the fit to one walk is from the truth on the others. Errors of its parameters are in it: a
  right law is off by more than the noise too.
* `left`: what the best values for all walks still miss of these, without their noise. A misfit can be seen at
  all where that is more than the noise: no values of the law's parameters do as well as the truth.
* whether the campaign notices.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from stickslip.estimate.result import Fit
from stickslip.friction import Elastoplastic, MaxwellSlip
from stickslip.identify.step.fit import identify_step
from stickslip.identify.walk.explained import Explained, explained
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import Actuator
from stickslip.recording import RecordingWarning
from stickslip.simulation import simulate
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.sequence import Sequence
from stickslip.waveform.shapes import Rest
from stickslip.waveform.slewed import Slewed

from .coverage import (
    BOUNDS,
    FITTED,
    FREE,
    LOW_PASS,
    POSITION,
    PRE_TRIGGER,
    clean_chain,
    example,
    noisy,
    random_truth,
)

# The first is fitted.
DRIVES = (
    FITTED,
    Sawtooth(45.0, 10.0, periods=8),
    Sawtooth(75.0, 20.0, periods=16),
    Sawtooth(40.0, 5.0, periods=6),
)
# Forces, lengths and velocities: what the sensor's scale moves.
SCALED = ("coulomb_force", "stiction_force", "strength", "breakaway_deflection", "damping_velocity")


def laws(actuator: Actuator, seed: int) -> dict[str, Actuator]:
    """One contact by each law."""
    random = np.random.default_rng([seed, 2])
    law = actuator.friction
    f, k = law.coulomb_force, law.sigma_0
    share = float(random.uniform(0.3, 0.8))
    made = {
        "LuGre": law,
        "Elastoplastic": Elastoplastic(k, law.sigma_1, 0.0, f, f, share * f / k),
        "MaxwellSlip": MaxwellSlip((share * k, (1.0 - share) * k), (0.5 * f, 0.5 * f), 0.1 * law.sigma_1),
        "Stribeck": law._replace(
            stiction_force=float(random.uniform(1.1, 1.5)) * f,
            damping_velocity=float(random.uniform(1e-3, 5e-3)),
        ),
    }
    return {name: actuator.replace(friction=one) for name, one in made.items()}


def in_sensor_metres(actuator: Actuator, scale: float) -> Actuator:
    """What the actuator looks like through a sensor that reads `scale` times the position."""
    law = actuator.friction
    changed = {
        field: tuple(scale * x for x in value) if isinstance(value, tuple) else scale * value
        for field, value in law._asdict().items()
        if field in SCALED
    }
    return actuator.replace(gain=scale * actuator.gain, friction=law._replace(**changed))


class Judged(NamedTuple):
    """See the module; `off` and `left` in deviations of the noise."""

    fit: Fit
    everything: Explained
    off: float
    left: float

    @property
    def seen(self) -> bool:
        """Whether the campaign says that the model lacks."""
        return any(lack.seen for lack in (*self.fit.lack, *self.everything.lacks))


def one(truth: Actuator, seed: int) -> Judged:
    """One campaign: a fit to one walk, then all walks."""
    chain = clean_chain(truth, DRIVES)
    slew = chain.bench.amplifier.max_current / chain.bench.piezo_capacitance
    random = np.random.default_rng(seed)
    steps = [noisy(chain, r, 1, 0.2, random) for r in chain.steps]
    stage = identify_step(steps, example(), filter=LOW_PASS, slew_rate=slew)
    walks, drives, quiet = [], [], []
    for i, (clean, drive) in enumerate(zip(chain.walks, DRIVES, strict=True)):
        shown = noisy(chain, clean, 20, PRE_TRIGGER, random)
        time = shown["time"].values
        walks.append(shown.assign_coords(time=time - time[0]).assign_attrs(title=f"walk {i + 1}"))
        quiet.append(walks[-1].assign({POSITION: clean[POSITION].copy(data=clean[POSITION].values)}))
        begin = PRE_TRIGGER if time[0] >= 0.0 else -float(time[0])
        drives.append(Slewed(Sequence(Rest(begin), drive), slew))
    walk = walks[0]
    noise = float(np.std(walk[POSITION].values - quiet[0][POSITION].values))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        fit = identify_friction(walk, stage.model, FREE, drive=drives[0], stage=stage, bounds=BOUNDS)
        everything = explained(fit, walks, drives, FREE, stage=stage, bounds=BOUNDS)
    times = np.arange(900) * 1e-3
    seen = in_sensor_metres(truth, chain.scale)
    off = []
    for unseen in DRIVES[1:]:
        pair = [
            simulate(model, unseen, times=times)["end_effector_position"].values
            for model in (seen, fit.model)
        ]
        off.append(float(np.mean((pair[0] - pair[1]) ** 2)))
    missed = []
    for clean, drive in zip(quiet, drives, strict=True):
        assert everything.known.predict is not None  # of an actuator
        missed.append(float(np.var(everything.known.predict(clean, drive) - clean[POSITION].values)))
    return Judged(
        fit, everything, float(np.sqrt(np.mean(off))) / noise, float(np.sqrt(np.mean(missed))) / noise
    )


def lack_of_fit(campaigns: int, among: Collection[str] = (), first: int = 0) -> dict[str, Any]:
    """Over so many campaigns of each law (or of those named), how many are said to lack, and where it can be
    seen."""
    found: dict[str, list[Judged]] = {}
    for seed in range(first, first + campaigns):
        for name, truth in laws(random_truth(seed), seed).items():
            if among and name not in among:
                continue
            judged = one(truth, seed)
            found.setdefault(name, []).append(judged)
            ratios = [f"{x.ratio:.3g}{'!' * x.seen}" for x in (*judged.fit.lack, *judged.everything.lacks)]
            print(
                seed, name, judged.seen, ratios, f"{judged.off:.3g} {judged.left:.3g}", file=sys.stderr
            )  # fmt: skip
    return {
        name: {
            "campaigns": len(rows),
            "noticed": sum(row.seen for row in rows),
            "visible": sum(row.left > 1.0 for row in rows),
            "noticed_of_visible": sum(row.seen for row in rows if row.left > 1.0),
            "one_walk_off": sum(row.off > 1.0 for row in rows),
            "noticed_of_off": sum(row.seen for row in rows if row.off > 1.0),
        }
        for name, rows in found.items()
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaigns", type=int, nargs="?", default=100)
    parser.add_argument("laws", nargs="*")
    parser.add_argument("--first", type=int, default=0, help="number of the first campaign")
    asked = parser.parse_args()
    print(json.dumps(lack_of_fit(asked.campaigns, asked.laws, asked.first), indent=1))
