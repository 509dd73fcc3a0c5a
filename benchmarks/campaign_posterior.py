"""The posterior of the thesis's campaign on the virtual rig, to convergence, beside the fit's own intervals.

    python -m benchmarks.campaign_posterior [MOST_SIMULATIONS]

Eight parameters, friction and stage together; about a minute on two processors. Writes
docs/benchmarks/posterior.md.
"""

from __future__ import annotations

import importlib.resources
import math
import os
import sys
import tempfile
import time
from pathlib import Path

from stickslip.jobs.campaign.additional import additional
from stickslip.jobs.campaign.evaluation import evaluate
from stickslip.jobs.campaign.file import read_campaign
from stickslip.jobs.campaign.gathering import gather
from stickslip.jobs.campaign.kept import Kept
from stickslip.physics.actuator import load_actuator
from stickslip.quantities.progress import unheard
from stickslip.quantities.units import with_prefix

from .results import write_page

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks" / "posterior.md"


def shown(ends: tuple[float, float], unit: str) -> str:
    """An interval, in one unit."""
    low, high = (with_prefix(one, unit) for one in ends)
    return f"{low} to {high}"


def main(most: int) -> None:
    """Record, fit, sample, write."""
    path = Path(str(importlib.resources.files("stickslip") / "examples" / "kang2007_campaign.yaml"))
    file = read_campaign(path).model_copy(update={"posterior": True, "posterior_simulations": most})
    with tempfile.TemporaryDirectory() as folder:
        gathered, _ = gather(file, path.parent, Path(folder), unheard)
        model = file.load_model(path.parent)
        found = evaluate(file, model, gathered, unheard)
    cpu, wall = time.process_time(), time.perf_counter()
    samples = additional(
        file, found.friction, found.walks, found.stage, False, path.parent, unheard, Kept()
    ).posterior
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    assert samples is not None
    assert found.stage is not None
    truth = load_actuator("kang2007")
    fits = {**found.stage.confidence_intervals(), **found.friction.confidence_intervals()}
    lines = ["| | truth | fit | fit, with all errors | posterior | ess |", "|---|---|---|---|---|---|"]
    for name in samples.summary["parameter"].values:
        row = {key: float(one) for key, one in samples.summary.sel(parameter=name).data_vars.items()}
        unit = str(samples.samples[name].attrs["units"])
        known = getattr(truth, name, getattr(truth.friction, name, math.nan))
        total = found.budget.intervals.get(name)
        cells = [
            name,
            with_prefix(known, unit) if math.isfinite(known) else "",
            shown(fits[name], unit),
            shown(total, unit) if total and name in found.friction.values else "",
            shown((row["low"], row["high"]), unit),
            f"{row['ess']:.0f}",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    load = os.getloadavg()[1]
    chain = samples.message
    took = f"{cpu:.0f} s of processor, {wall:.0f} s by the clock"
    measured = f"Load {load:.1f}; {took}; {chain}."
    print(write_page(PAGE, {"measured": measured, "intervals": "\n".join(lines)}))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 30_000)
