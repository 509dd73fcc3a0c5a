"""Planned recordings against the thesis's, in virtual campaigns: ``python -m benchmarks.plan 200 20 30``.

Parts, each with so many campaigns, all of equal recording time, with the noise, drift and rounding of
the bench's inductive sensor behind its filter:

- `scatter`: the motion is the model's, later by the sensor's delay: the plan's own assumptions. Do fits
  scatter as was expected?
- `bench`: the motion came through the whole virtual bench (held output, amplifier, sensor curve, filter),
  which the fit does not know: what is left of the plan?
- `driven`: the same recordings, and the fit is given the drive as converter and amplifier make it.
- `unknown`: as `scatter`, but every campaign has an actuator of its own, and plan and fits begin at the
  example.

What the plan is compared with has 40 campaigns of the first part at most.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

import stickslip as ss
from stickslip.design import Plan
from stickslip.estimate.problem import FitError
from stickslip.identify import PlannedWalk
from stickslip.physics.actuator import Actuator
from stickslip.recording import RecordingWarning
from stickslip.rig import Capture, Channel, Limits, VirtualRig, measure
from stickslip.waveform import Rest
from stickslip.waveform import Sequence as Parts
from stickslip.waveform.signal import Waveform, value_at

from .coverage import LOW_PASS, POSITION, Chain, clean_chain, example, load_calibration, noise

FREE = ("sigma_0", "sigma_1", "coulomb_force", "natural_frequency", "damping_ratio", "gain")
RATE, STRIDE = 2e3, 10  # Hz, and of the rig's samples
DELAY = 0.8e-3  # s, of sensor and filter
BEFORE = 0.1  # s at rest
AT_REST = 20_000  # samples of the recording that the plan's noise is from
MOST_DEFAULT = 40  # campaigns of `scatter` with the default recordings, whose fits take longest
LIMITS = Limits(max_voltage=100.0, min_position=-200e-6, max_position=400e-6)
LONG, RECORDINGS = 1.6, 3
# Of the actuators of `unknown`: times or over at most.
AWAY = {
    "sigma_0": 1.5,
    "sigma_1": 1.5,
    "coulomb_force": 1.2,
    "natural_frequency": 1.1,
    "damping_ratio": 1.2,
    "gain": 1.05,
}


class Setup(NamedTuple):
    """Recordings to be made, by name: drives in the time of the recordings, each with its length."""

    drives: Sequence[Waveform]
    length: float


def plan(chain: Chain, **how: Any) -> Plan:
    """The plan of the benchmark."""
    random = np.random.default_rng(2007)
    return ss.plan_experiment(
        example(),
        free=FREE,
        noise=rest(chain, random),
        limits=LIMITS,
        duration=LONG,
        recordings=RECORDINGS,
        chain=ss.recording.Chain(delay=DELAY, slew_rate=slew(chain), zeroed=True),
        **how,
    )


def rest(chain: Chain, random: np.random.Generator) -> xr.Dataset:
    """A recording at rest."""
    x = noise(chain, AT_REST, STRIDE, random)
    return ss.make_recording(np.arange(AT_REST) / RATE, {POSITION: x - x[0]})


def slew(chain: Chain) -> float:
    """V/s that the amplifier's current allows."""
    return chain.bench.amplifier.max_current / chain.bench.piezo_capacitance


def setups(planned: Plan) -> dict[str, Setup]:
    """Planned and default, of equal time."""
    walks = [w for w in planned.recordings.values() for _ in range(w.repeats)]
    drives = [Parts(Rest(BEFORE), (w.drive, w.duration)) for w in walks]
    usual = Parts(Rest(BEFORE), (ss.Sawtooth(65.0, 5.0), LONG))
    return {"planned": Setup(drives, LONG), "default": Setup([usual] * RECORDINGS, LONG)}


def motions(actuator: Actuator, setup: Setup) -> list[xr.Dataset]:
    """What a sensor with nothing but a delay shows, without noise."""
    found = []
    for drive in setup.drives:
        t = PlannedWalk(drive, setup.length + BEFORE, RATE, 1e-9).times
        late = np.append(0.0, np.maximum(t[1:] - DELAY, 1e-12))
        late = np.maximum.accumulate(late + 1e-13 * np.arange(t.size))
        x = ss.simulate(actuator, drive, times=late, tolerance=1e-11).end_effector_position.values
        found.append(ss.make_recording(t, {POSITION: x}))
    return found


def through_the_bench(chain: Chain, setup: Setup) -> list[xr.Dataset]:
    """What the bench shows, without noise."""
    calibrations = tuple(load_calibration(n) for n in ("kang2007-inductive-5", "kang2007-recalibration"))
    channels = {
        "drive_voltage": Channel("drive"),
        POSITION: Channel("inductive", calibrations, LOW_PASS, zero=True),
    }
    found = []
    for drive in setup.drives:
        capture = Capture(length=setup.length + BEFORE, interval=1.0 / RATE, pre_trigger=BEFORE)
        inner = drive.parts[1][0]  # type: ignore[attr-defined]
        made = measure(VirtualRig(chain.truth, chain.bench), inner, channels, capture, LIMITS)
        found.append(ss.make_recording(made["time"].values, {POSITION: made[POSITION].values}))
    return found


def at_piezo(chain: Chain, setup: Setup) -> Setup:
    """The same, as the converter holds it and the amplifier follows, computed from their data sheets."""
    bench, drives = chain.bench, []
    for drive in setup.drives:
        times = np.arange(0.0, setup.length + BEFORE, 1.0 / bench.dac.update_rate)
        step = bench.dac.step * bench.amplifier.gain
        command = ss.Sampled(times, step * np.rint(value_at(drive, times) / step), "hold")
        drives.append(
            ss.physics.electronics.driven(bench.amplifier, command, bench.piezo_capacitance, times[-1])
        )
    return setup._replace(drives=drives)


def fitted(
    chain: Chain, clean: Sequence[xr.Dataset], setup: Setup, model: Actuator, seed: int, hops: int
) -> dict[str, Any]:
    """Values, standard errors and intervals of one campaign."""
    random = np.random.default_rng([seed, 17])
    made = []
    for i, one in enumerate(clean):
        x = one[POSITION].values + noise(chain, one.sizes["time"], STRIDE, random)
        x = x - x[one["time"].values < BEFORE].mean()
        made.append(ss.make_recording(one["time"].values, {POSITION: x}, title=f"walk {i + 1}"))
    begun = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        fit = ss.identify_friction(
            made,
            model,
            FREE,
            drive=setup.drives,
            channel=("delay", "offset"),
            initial={"delay": DELAY},
            noise=rest(chain, random),
            hops=hops,
        )
    ends = fit.confidence_intervals()
    return {
        "values": [fit.values[n] for n in FREE],
        "errors": [fit.standard_errors[n] for n in FREE],
        "low": [ends[n][0] for n in FREE],
        "high": [ends[n][1] for n in FREE],
        "rmse": fit.rmse,
        "converged": fit.converged,
        "seconds": time.perf_counter() - begun,
    }


def table(found: Sequence[dict[str, Any]], truths: Sequence[Sequence[float]]) -> dict[str, Any]:
    """By parameter, as shares of the truth: scatter, half-width, bias; how many intervals hold it."""
    values, low, high, errors = (np.array([f[k] for f in found]) for k in ("values", "low", "high", "errors"))
    true = np.array(truths)
    ratio = values / true
    rows = {}
    for i, name in enumerate(FREE):
        rows[name] = {
            "scatter": float(np.std(ratio[:, i], ddof=1)),
            "robust_scatter": float(1.4826 * np.median(np.abs(ratio[:, i] - np.median(ratio[:, i])))),
            "standard_error": float(np.nanmedian(errors[:, i] / true[:, i])),
            "half_width": float(np.median((high - low)[:, i] / true[:, i]) / 2.0),
            "bias": float(np.median(ratio[:, i]) - 1.0),
            "coverage": float(np.mean((low[:, i] <= true[:, i]) & (true[:, i] <= high[:, i]))),
        }
    return {
        "campaigns": len(found),
        "converged": float(np.mean([f["converged"] for f in found])),
        "rmse": float(np.median([f["rmse"] for f in found])),
        "seconds": float(np.median([f["seconds"] for f in found])),
        "parameters": rows,
    }


def values_of(actuator: Actuator, scale: float = 1.0) -> list[float]:
    """The truth in metres of a sensor that reads `scale` for a metre."""
    of = actuator._asdict() | actuator.friction._asdict()
    return [of[n] * (scale if n in ("gain", "coulomb_force") else 1.0) for n in FREE]


def another(seed: int) -> Actuator:
    """An actuator of `unknown`."""
    random, actuator = np.random.default_rng([seed, 3]), example()
    factors = {n: float(np.exp(random.uniform(-1.0, 1.0) * np.log(most))) for n, most in AWAY.items()}
    law = actuator.friction
    force = law.coulomb_force * factors["coulomb_force"]
    law = law._replace(
        sigma_0=law.sigma_0 * factors["sigma_0"],
        sigma_1=law.sigma_1 * factors["sigma_1"],
        coulomb_force=force,
        stiction_force=force,
    )
    stage = {n: getattr(actuator, n) * factors[n] for n in ("natural_frequency", "damping_ratio", "gain")}
    return actuator.replace(friction=law, **stage)


def run(scatter: int, bench: int, unknown: int) -> dict[str, Any]:
    """All parts."""
    actuator = example()
    chain = clean_chain(actuator)
    planned = plan(chain)
    print(planned.report(), file=sys.stderr, flush=True)
    of = planned.dataset
    found: dict[str, Any] = {
        "recordings": {name: w.repeats for name, w in planned.recordings.items()},
        "expected": {
            "planned": dict(zip(FREE, (of["half_width"].values / 1.959964).tolist(), strict=True)),
            "default": dict(zip(FREE, (of["default_half_width"].values / 1.959964).tolist(), strict=True)),
        },
    }
    scaled = actuator.replace(gain=actuator.gain * chain.scale)
    for name, setup in setups(planned).items():
        if scatter:
            clean = motions(actuator, setup)
            count = scatter if name == "planned" else min(scatter, MOST_DEFAULT)
            each = [fitted(chain, clean, setup, actuator, seed, 0) for seed in range(count)]
            found[f"scatter {name}"] = table(each, [values_of(actuator)] * count)
            told(name, "scatter", found)
        if bench:
            clean = through_the_bench(chain, setup)
            each = [fitted(chain, clean, setup, scaled, seed, 0) for seed in range(bench)]
            found[f"bench {name}"] = table(each, [values_of(actuator, chain.scale)] * bench)
            told(name, "bench", found)
            known = at_piezo(chain, setup)
            each = [fitted(chain, clean, known, scaled, seed, 0) for seed in range(bench)]
            found[f"driven {name}"] = table(each, [values_of(actuator, chain.scale)] * bench)
            told(name, "driven", found)
        if unknown:
            each, true, lost = [], [], 0
            for seed in range(unknown):
                own = another(seed)
                try:
                    each.append(fitted(chain, motions(own, setup), setup, actuator, seed, 6))
                    true.append(values_of(own))
                except FitError:
                    lost += 1
            found[f"unknown {name}"] = table(each, true) | {"lost": lost}
            told(name, "unknown", found)
    return found


def told(name: str, part: str, found: dict[str, Any]) -> None:
    """Progress, to the console."""
    print(part, name, json.dumps(found[f"{part} {name}"], indent=1), file=sys.stderr, flush=True)


if __name__ == "__main__":
    first, second, third = [int(one) for one in sys.argv[1:4]] or [200, 20, 30]
    print(json.dumps(run(first, second, third), indent=1))
