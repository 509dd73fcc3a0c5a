"""Do intervals hold where nothing is said? Campaigns with the faults of real instruments.

Each campaign: an actuator drawn at random, three clamped steps and three walks recorded by a simulator that
is not the package's (`simulator`), one fault of an instrument or of the model in all recordings (`faults`),
CSV files, a campaign file, and the package's own `run_campaign`, which knows nothing of the truth.

    python -m benchmarks.instruments 200 out/instruments.jsonl

continues where the file ends, and prints the table of docs/benchmarks/instruments.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from stickslip import load_actuator
from stickslip.jobs.campaign.running import run_campaign

from .faults import PLANT, SINGLE, SIZES, Recorded, recorded
from .simulator import Motion, Truth, motion, sawtooth, step
from .table import table

REST, AFTER = 0.06, 0.02  # s at rest before a drive, and after a walk
STEPS = (60.0, 70.0, 80.0)  # V
BEGIN = {
    "sigma_0": "1000 N/mm",
    "sigma_1": "0.03 N s/mm",
    "coulomb_force": "1.5 N",
    "stiction_force": "1.5 N",
}
STAGE = ("gain", "natural_frequency", "damping_ratio")


def drawn(random: np.random.Generator, kind: str, size: float) -> Truth:
    """Return an actuator near the example's: sigma_0, sigma_1 within a factor of 3, the others 1.5 to 2."""
    a = load_actuator("kang2007")
    law = a.friction

    def away(most: float) -> float:
        return float(np.exp(random.uniform(-1.0, 1.0) * np.log(most)))

    force = law.coulomb_force * away(2.0)
    return Truth(
        gain=a.gain * away(1.5),
        natural_frequency=a.natural_frequency * away(1.5),
        damping_ratio=a.damping_ratio * away(1.5),
        stage_mass=a.stage_mass,
        end_effector_mass=a.end_effector_mass,
        sigma_0=law.sigma_0 * away(3.0),
        sigma_1=law.sigma_1 * away(3.0),
        sigma_2=size if kind == "viscous" else 0.0,
        coulomb_force=force,
        stiction_force=force * (size if kind == "stiction" else 1.0),
        stribeck_velocity=1e-3,
        asymmetry=0.5 * size if kind == "asymmetry" else 0.0,
        unevenness=size if kind == "unevenness" else 0.0,
        length=float(random.uniform(2e-6, 30e-6)),
        reaction=1.0 if kind == "reaction" else 0.0,
    )


def campaign(seed: int, kinds: list[str]) -> dict[str, Any]:
    """Return what one campaign found, what it said, and the truth."""
    random = np.random.default_rng([seed, 46])
    kind = kinds[seed % len(kinds)]
    low, high, _ = SIZES[kind]
    size = float(low * (high / low) ** random.random())
    truth = drawn(random, kind, size)
    noise, delay = float(random.uniform(3e-9, 15e-9)), float(random.uniform(0.0, 4e-4))
    rate = float(random.choice([1e3, 2e3, 4e3]))
    made: dict[str, Any] = {"seed": seed, "kind": kind, "size": size, "rate": rate, "noise": noise}
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        # An instrument fails in all of the six recordings, or in one of them.
        only = int(random.integers(6)) if kind in SINGLE and random.random() < 0.5 else None
        made["recording"] = only
        faults = [("none", 1.0) if kind in PLANT or only not in (None, i) else (kind, size) for i in range(6)]
        recordings = []
        for i, volts in enumerate(STEPS):
            moved = motion(truth._replace(clamped=1.0), step(volts, 0.2), 0.26)
            shown = recorded(moved, 0.25, 50e-6, noise, delay, faults[i], random)
            wave = [{"shape": "Step", "fields": {"amplitude": volts}}]
            recordings.append(_file(place, f"step_{volts:.0f}V", "step", shown, wave))
        walks = [(65.0, 5.0, 6, "fit"), (45.0, 10.0, 8, "verify"), (75.0, 20.0, 12, "verify")]
        for i, (volts, frequency, periods, use) in enumerate(walks, start=3):
            length = REST + periods / frequency + AFTER
            moved: Motion = motion(truth, sawtooth(volts, frequency, periods, REST), length + 0.01)
            shown = recorded(moved, length, 1.0 / rate, noise, delay, faults[i], random)
            fields = {"amplitude": volts, "frequency": frequency, "periods": periods}
            wave = [{"shape": "Sawtooth", "fields": fields}]
            recordings.append(_file(place, f"walk_{volts:.0f}V_{frequency:.0f}Hz", use, shown, wave))
        file = {
            "title": f"campaign {seed}",
            "model": "kang2007",
            "change": {"stage_reaction": False},
            "friction": BEGIN,
            "slew_rate": "286 V/ms",
            "recordings": recordings,
        }
        (place / "campaign.yaml").write_text(yaml.safe_dump(file))
        began = time.process_time()
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                document = run_campaign(place / "campaign.yaml", place / "out", figures=False)
        except Exception as error:
            return made | {"error": f"{type(error).__name__}: {error}"[:400], "cpu": _since(began)}
    numbers = document.numbers
    shown = numbers["friction"]["parameters_with_all_errors"] | {
        name: numbers["stage"]["parameters"][name] for name in STAGE
    }
    return made | {
        "cpu": _since(began),
        "failures": list(document.failures),
        "said": [
            *numbers["friction"].get("undetermined", []), *numbers["friction"].get("remarks", []),
            *numbers["stage"].get("undetermined", []), *numbers["stage"].get("remarks", []),
            *dict.fromkeys(str(w.message) for w in caught),
        ],
        "summary": document.summary,
        "truth": {name: getattr(truth, name) for name in shown if hasattr(truth, name)},
        "found": {
            name: [n.value, n.low, n.high] for name, n in shown.items() if hasattr(truth, name)
        },
    }  # fmt: skip


def _since(began: float) -> float:
    return round(time.process_time() - began, 2)


def _file(
    place: Path, name: str, use: str, shown: Recorded, waveform: list[dict[str, Any]]
) -> dict[str, Any]:
    np.savetxt(place / f"{name}.csv", np.column_stack(shown), delimiter=",", header="t,x,u", comments="")
    return {
        "file": f"{name}.csv",
        "use": use,
        "columns": {"time": "t", "end_effector_position": "x", "drive_voltage": "u"},
        "units": {"time": "s", "end_effector_position": "m", "drive_voltage": "V"},
        "waveform": waveform,
    }


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("count", type=int, nargs="?", default=200)
    asked.add_argument("file", type=Path, nargs="?", default=Path("out/instruments.jsonl"))
    asked.add_argument("--first", type=int, default=0, help="number of the first campaign")
    asked.add_argument("--kinds", nargs="*", default=list(SIZES), choices=list(SIZES))
    given = asked.parse_args()
    given.file.parent.mkdir(parents=True, exist_ok=True)
    lines = given.file.read_text().splitlines() if given.file.exists() else []
    found = [json.loads(line) for line in lines]
    known = {one["seed"] for one in found}
    for seed in range(given.first, given.first + given.count):
        if seed in known:
            continue
        found.append(campaign(seed, given.kinds))
        with given.file.open("a") as out:
            out.write(json.dumps(found[-1]) + "\n")
        print(seed, found[-1]["kind"], found[-1]["cpu"], found[-1].get("error", ""), file=sys.stderr)
    print(table(found))


if __name__ == "__main__":
    main()
