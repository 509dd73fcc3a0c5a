"""How often 95 % intervals hold the truth: campaigns of the virtual rig, each with noise of its own.

Each campaign has an actuator of its own too (`random_truth`), while every fit begins at the example's values:
``python -m benchmarks.coverage 300 STORE``. With ``fixed`` behind them, the actuator is that of the example.
It is a study whose members are campaigns: the same command goes on, ``--scheduler ADDRESS`` is for a cluster.

The signal chain is the bench's: held output, amplifier with its current limit, sensor with curve, bandwidth
and delay, converters, filter. The motion is computed without noise; each campaign adds the sensor's
noise and drift, filtered as the bench does. The truth is in metres of the sensor: its calibration reads 3.4 %
low where the bench works, in every campaign alike, which no statistics of the recordings can show.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import warnings
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.interpolate import CubicSpline

from stickslip.identify.step.fit import identify_step
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import Actuator, load_actuator
from stickslip.physics.electronics import Filter, InductiveSensor, filtered
from stickslip.physics.electronics.noise import random_walk, white_noise
from stickslip.recording import RecordingWarning
from stickslip.recording.calibration import load_calibration
from stickslip.rig import Capture, Channel, Limits, VirtualRig, load_bench, measure
from stickslip.study import Grid, Own, Study, run_study
from stickslip.waveform.periodic import Sawtooth
from stickslip.waveform.shapes import Step

CAMPAIGNS, LEVEL = 300, 0.95
LOW_PASS = Filter(2, 2e3)
POSITION = "end_effector_position"
FREE = ("sigma_0", "sigma_1", "coulomb_force", "delay", "offset")
BOUNDS = {"delay": (0.0, 5e-3)}
OVERSAMPLING = 4
FITTED = Sawtooth(65.0, 5.0, periods=8)
PRE_TRIGGER = 0.05  # s
STAGE = ("gain", "natural_frequency", "damping_ratio")


class Chain(NamedTuple):
    """Recordings without noise, and what is needed to add it."""

    steps: list[xr.Dataset]
    walks: list[xr.Dataset]
    metres_per_volt: float
    scale: float  # what the calibrated sensor reads for a metre
    bench: Any
    truth: Actuator


def example() -> Actuator:
    """Where every fit begins."""
    return load_actuator("kang2007").replace(stage_reaction=False)


def random_truth(seed: int) -> Actuator:
    """The example with sigma_0 and sigma_1 times or over 3, F_C 2, the stage's values 1.5, each at random."""
    random = np.random.default_rng([seed, 1])
    actuator, law = example(), example().friction

    def away(most: float) -> float:
        return float(np.exp(random.uniform(-1.0, 1.0) * np.log(most)))

    force = law.coulomb_force * away(2.0)
    contact = law._replace(
        sigma_0=law.sigma_0 * away(3.0),
        sigma_1=law.sigma_1 * away(3.0),
        coulomb_force=force,
        stiction_force=force,
    )
    stage = {name: getattr(actuator, name) * away(1.5) for name in STAGE}
    return actuator.replace(friction=contact, **stage)


def clean_chain(actuator: Actuator, drives: Sequence[Sawtooth] = (FITTED,)) -> Chain:
    """The recordings of the thesis without noise: three steps, and walks; first the one that it fits."""
    bench = load_bench("kang2007-bench")
    mounted = bench.sensors["inductive"]
    assert isinstance(mounted.sensor, InductiveSensor)
    quiet = mounted.sensor._replace(noise_density=0.0, drift=0.0)
    assert mounted.adc is not None
    fine = mounted.adc._replace(bits=24)  # noise makes the steps of 16 bits act like noise; added later
    mounted = dataclasses.replace(mounted, sensor=quiet, adc=fine)
    bench = bench.replace(sensors={**bench.sensors, "inductive": mounted})
    calibrations = tuple(load_calibration(n) for n in ("kang2007-inductive-5", "kang2007-recalibration"))
    channels = {
        "drive_voltage": Channel("drive"),
        POSITION: Channel("inductive", calibrations, LOW_PASS, zero=True),
    }
    limits = Limits(max_voltage=100.0)
    step = Capture(length=0.25, interval=50e-6, pre_trigger=0.2)
    steps = [
        measure(VirtualRig(actuator.replace(clamped=True), bench), Step(v), channels, step, limits)
        for v in (60.0, 70.0, 80.0)
    ]
    walks = []
    for drive in drives:
        capture = Capture(length=round(drive.duration + 0.3, 3), interval=1e-3, pre_trigger=PRE_TRIGGER)
        walks.append(measure(VirtualRig(actuator, bench), drive, channels, capture, limits))
    volts = CubicSpline(quiet.gaps, quiet.voltages)(quiet.standoff + np.array([0.0, 4e-6]))
    per_volt = 4e-6 / float(volts[1] - volts[0])
    read = volts
    for calibration in calibrations:
        read = calibration(read)
    scale = float(read[1] - read[0]) / 4e-6
    return Chain(steps, walks, per_volt * scale, scale, bench, actuator)


def noise(chain: Chain, count: int, stride: int, random: np.random.Generator) -> np.ndarray:
    """Noise of the calibrated, filtered position, m, shape (count,); every `stride`th sample of the rig's."""
    sensor = load_bench("kang2007-bench").sensors["inductive"].sensor
    assert isinstance(sensor, InductiveSensor)
    rate, settle = chain.bench.sample_rate, 400
    n = OVERSAMPLING * (count * stride + settle)
    volts = white_noise(n, sensor.noise_density, OVERSAMPLING * rate, random)
    volts = volts + random_walk(n, sensor.drift, OVERSAMPLING * rate, random)
    seen = filtered(chain.bench.anti_alias, volts, OVERSAMPLING * rate)[::OVERSAMPLING]
    step = 20.0 / 2**16
    seen = np.round(seen / step) * step
    return chain.metres_per_volt * filtered(LOW_PASS, seen, rate)[settle::stride][:count]


def noisy(
    chain: Chain, recording: xr.Dataset, stride: int, before: float, random: np.random.Generator
) -> xr.Dataset:
    """The recording with noise, zeroed before the trigger as the bench does."""
    x = recording[POSITION].values + noise(chain, recording.sizes["time"], stride, random)
    x = x - x[recording["time"].values < before].mean()
    return recording.assign({POSITION: recording[POSITION].copy(data=x)})


def campaigns(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Campaigns by their seeds, each with an actuator of its own: for a study."""
    return _columns([campaign(clean_chain(random_truth(int(one))), int(one), 6) for one in columns["seed"]])


def fixed_campaigns(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Of the example, whose fits begin at the truth and look nowhere else."""
    return _columns([campaign(_example_chain(), int(one), 0) for one in columns["seed"]])


@cache
def _example_chain() -> Chain:
    return clean_chain(example())


def _columns(found: list[dict[str, float]]) -> dict[str, np.ndarray]:
    return {name: np.array([one[name] for one in found]) for name in found[0]}


def campaign(chain: Chain, seed: int, hops: int) -> dict[str, float]:
    """Value and ends of the interval of every parameter of one campaign, and its truth."""
    random = np.random.default_rng(seed)
    slew = chain.bench.amplifier.max_current / chain.bench.piezo_capacitance
    actuator = example()
    steps = [noisy(chain, r, 1, 0.2, random) for r in chain.steps]
    stage = identify_step(steps, actuator, filter=LOW_PASS, slew_rate=slew)
    walk = noisy(chain, chain.walks[0], 20, PRE_TRIGGER, random)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        fit = identify_friction(
            walk, stage.model, FREE, slew_rate=slew, stage=stage, hops=hops, bounds=BOUNDS
        )
    found = {f"truth_{name}": true for name, true in truths(chain).items()}
    for one in (stage, fit):
        for name, (low, high) in one.confidence_intervals(LEVEL).items():
            key = f"walk_{name}" if name == "delay" and one is fit else name
            found |= {key: one.values[name], f"{key}_low": low, f"{key}_high": high}
    found["converged"] = float(fit.converged and stage.converged)
    for name in FREE:
        lost = any(s.startswith((f"{name} is not", f"{name} ended at")) for s in fit.undetermined)
        found[f"undetermined_{name}"] = float(lost)
    return found


def truths(chain: Chain) -> dict[str, float]:
    """What the intervals should hold."""
    a = chain.truth
    return {
        "damping_ratio": a.damping_ratio,
        "natural_frequency": a.natural_frequency,
        "gain": a.gain * chain.scale,
        "sigma_0": a.friction.sigma_0,
        "sigma_1": a.friction.sigma_1,
        "coulomb_force": a.friction.coulomb_force * chain.scale,
    }


def table(found: xr.Dataset) -> dict[str, Any]:
    """Share of intervals that hold the truth, and errors relative to it, over all campaigns, by parameter."""
    parameters = {}
    for name in (str(key).removeprefix("truth_") for key in found if str(key).startswith("truth_")):
        true, values, low, high = (
            found[n].values for n in (f"truth_{name}", name, f"{name}_low", f"{name}_high")
        )
        lost = f"undetermined_{name}"
        parameters[name] = {
            "coverage": float(np.mean((low <= true) & (true <= high))),
            "missing": int(np.sum(~np.isfinite(values))),
            "median_error": float(np.median(values / true - 1.0)),
            "spread": float(np.std(values / true)),
            "half_interval": float(np.median((high - low) / true) / 2),
            "undetermined": float(found[lost].mean()) if lost in found else 0.0,
        }
    return {
        "campaigns": found.sizes["seed"],
        "level": LEVEL,
        "converged": float(found["converged"].mean()),
        "parameters": parameters,
    }


def coverage(count: int, store: str, fixed: bool = False, scheduler: str | None = None) -> dict[str, Any]:
    """`table` of so many campaigns.

    Args:
        count: how many.
        store: of the study.
        fixed: the example is the truth of all, and the fits begin there.
        scheduler: address of a dask scheduler.
    """
    of = f"{__file__}:{'fixed_campaigns' if fixed else 'campaigns'}"
    study = Study(Grid({"seed": np.arange(float(count))}), Own(of), task=1, title="coverage of campaigns")

    def told(doing: str, share: float) -> None:
        print(f"{share:.0%} {doing}", file=sys.stderr)

    found = run_study(study, store, scheduler=scheduler, progress=told).load()
    failed = found.sel(seed=found["status"] != 0)
    assert not failed.sizes["seed"], failed["reason"].values
    return table(found)


if __name__ == "__main__":
    asked = argparse.ArgumentParser()
    asked.add_argument("count", type=int, nargs="?", default=CAMPAIGNS)
    asked.add_argument("store", nargs="?", default="out/coverage.zarr")
    asked.add_argument("fixed", nargs="?", choices=["fixed"])
    asked.add_argument("--scheduler")
    given = asked.parse_args()
    print(json.dumps(coverage(given.count, given.store, bool(given.fixed), given.scheduler), indent=1))
