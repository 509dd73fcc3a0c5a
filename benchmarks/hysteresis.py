"""How often 95 % intervals of the friction hold the truth on a hysteretic bench, and whether a linear stage
is noticed: ``python -m benchmarks.hysteresis 100``; the number of the first campaign may follow.

Campaigns as in the example `kang2007_hysteresis_campaign.yaml`, less two of its walks. Each has an actuator
of its own: friction, mode and gain as in `benchmarks.coverage`, thresholds and weights of its plays and its
creep at random too (`random_stage`), with noise and drift of its own. Every fit begins at the example's
values and knows nothing of the truth. Each is evaluated once more with a stage without hysteresis and creep,
steps and one search for the friction only; every `WHOLE`th predicts a walk too, and says whether its model
explains both walks.
"""

from __future__ import annotations

import importlib.resources
import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stickslip.jobs.analysis.alignment import Aligned, aligned
from stickslip.jobs.campaign.evaluation import CampaignResult, evaluate
from stickslip.jobs.campaign.file import CampaignFile, read_campaign
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.piezo import Creep, Piezo, PrandtlIshlinskii
from stickslip.quantities.progress import unheard
from stickslip.rig import VirtualRig, load_bench, measure
from stickslip.rig.experiment.cells import Cell, cells
from stickslip.rig.experiment.laboratory import open_laboratory
from stickslip.rig.experiment.running import read_experiment

from .coverage import LEVEL, random_truth

CAMPAIGNS, WHOLE = 100, 8
EXAMPLE = Path(str(importlib.resources.files("stickslip") / "examples" / "kang2007_hysteresis_campaign.yaml"))
USES = {
    "loops": "piezo",
    "step_40V": "step",
    "step_60V": "step",
    "step_80V": "step",
    "sawtooth_5Hz_65V": "fit",
    "sawtooth_20Hz_75V": "verify",
}
FRICTION = ("sigma_0", "sigma_1", "coulomb_force")
MODE = ("natural_frequency", "damping_ratio")


class Example(NamedTuple):
    """The campaign's file, its recordings to be, and the model at which fits begin."""

    file: CampaignFile
    cells: dict[str, Cell]
    start: Actuator


def example() -> Example:
    """That of the package."""
    file = read_campaign(EXAMPLE)
    assert file.experiment is not None
    experiment = read_experiment(EXAMPLE.parent / file.experiment)
    laboratory = open_laboratory(experiment, EXAMPLE.parent)
    try:
        known = {one.name: one for one in cells(experiment, EXAMPLE.parent, laboratory)}
    finally:
        laboratory.close()
    start = file.load_model(EXAMPLE.parent)
    return Example(file, {name: known[name] for name in USES}, start)


def random_stage(seed: int) -> Actuator:
    """`random_truth` with hysteresis and creep: half to three quarters of the gain follow at once, the rest
    by eight plays of thresholds to 60 V; creep of 0.5 to 2.5 % per decade."""
    random = np.random.default_rng([seed, 3])
    at_once = float(random.uniform(0.5, 0.75))
    thresholds = np.sort(random.uniform(1.0, 60.0, 8))
    weights = (1.0 - at_once) * random.dirichlet(np.full(8, 2.0))
    hysteresis = PrandtlIshlinskii((0.0, *thresholds.tolist()), (at_once, *weights.tolist()))
    creep = Creep.logarithmic(float(random.uniform(0.005, 0.025)), 0.1, 100.0)
    base, truth = load_actuator("kang2007-hysteresis"), random_truth(seed)
    gain = truth.gain * base.gain / load_actuator("kang2007").gain
    return truth.replace(gain=gain, piezo=Piezo(hysteresis, creep))


def record(known: Example, truth: Actuator, seed: int) -> list[Aligned]:
    """The recordings of one campaign."""
    bench, found = load_bench("kang2007-hysteresis-bench"), []
    for i, (name, cell) in enumerate(known.cells.items()):
        actuator = truth.replace(clamped=cell.actuator.clamped)
        rig = VirtualRig(actuator, bench, seed=1000 * seed + i)
        recording = measure(rig, cell.drive, cell.channels, cell.capture, cell.limits)
        one = aligned(recording, cell.drive, name, known.file.slew_rate)
        found.append(one._replace(use=USES[name]))
    return found


def noticed(found: CampaignResult) -> bool:
    """Whether a campaign says that its models do not explain their recordings."""
    assert found.stage is not None
    return any(one.seen for one in (*found.stage.lack, *found.friction.lack, *found.everything.lacks))


def campaign(known: Example, seed: int) -> dict[str, Any]:
    """What one campaign finds: by parameter (value, low, high, truth), and what it notices."""
    truth = random_stage(seed)
    recordings, whole = record(known, truth, seed), seed % WHOLE == 0
    used = [one for one in recordings if whole or one.use != "verify"]
    found = evaluate(known.file, known.start, used, unheard)
    assert found.hysteresis is not None
    assert found.stage is not None
    law, rows = truth.friction, {}
    for name in FRICTION:
        rows[name] = (found.friction.values[name], *found.budget.intervals[name], getattr(law, name))
    alone = found.friction.confidence_intervals(LEVEL)
    for name in FRICTION:
        rows[f"{name} by the fit alone"] = (found.friction.values[name], *alone[name], getattr(law, name))
    stage = found.hysteresis.widened(found.stage)
    for name, ends in stage.confidence_intervals(LEVEL).items():
        if name in MODE:
            rows[name] = (stage.values[name], *ends, getattr(truth, name))
    lost = [
        n
        for n in FRICTION
        if any(s.startswith((f"{n} is not", f"{n} ended at")) for s in found.friction.undetermined)
    ]
    result: dict[str, Any] = {
        "seed": seed,
        "rows": {name: [float(x) for x in row] for name, row in rows.items()},
        "undetermined": lost,
        "straight_leaves": found.hysteresis.straight_leaves,
    }
    if whole:
        result["lack"] = noticed(found)
        result["r_squared_unseen"] = float(found.verification.table["r_squared"].values[-1])
    file = known.file.model_copy(update={"hops": 0})
    linear = evaluate(file, known.start, [one for one in used if one.use in ("step", "fit")], unheard)
    result["linear_noticed"] = noticed(linear)
    result["linear_steps_noticed"] = any(one.seen for one in linear.stage.lack) if linear.stage else False
    return result


def table(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares over campaigns, by parameter."""
    parameters = {}
    for name in found[0]["rows"]:
        value, low, high, true = np.array([one["rows"][name] for one in found]).T
        parameters[name] = {
            "coverage": float(np.mean((low <= true) & (true <= high))),
            "median_error": float(np.median(value / true - 1.0)),
            "half_interval": float(np.median((high - low) / true) / 2),
            "undetermined": float(np.mean([name in one["undetermined"] for one in found])),
        }
    whole = [one for one in found if "lack" in one]
    return {
        "campaigns": len(found),
        "level": LEVEL,
        "parameters": parameters,
        "least_straight_leaves": min(one["straight_leaves"] for one in found),
        "with_unseen_walk": len(whole),
        "said_to_lack": sum(one["lack"] for one in whole),
        "r_squared_unseen": [one["r_squared_unseen"] for one in whole],
        "linear_noticed": sum(one["linear_noticed"] for one in found),
        "linear_noticed_by_steps_alone": sum(one["linear_steps_noticed"] for one in found),
    }


def coverage(campaigns: int = CAMPAIGNS, first: int = 0) -> dict[str, Any]:
    """`table` of so many campaigns, with the time that each took; one line of each to standard error."""
    known, found = example(), []
    begun = time.process_time()
    for seed in range(first, first + campaigns):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found.append(campaign(known, seed))
        print(json.dumps(found[-1]), file=sys.stderr, flush=True)
    return table(found) | {"cpu_seconds_per_campaign": (time.process_time() - begun) / campaigns}


if __name__ == "__main__":
    numbers = [int(one) for one in sys.argv[1:3]]
    print(json.dumps(coverage(*(numbers or [CAMPAIGNS])), indent=1))
