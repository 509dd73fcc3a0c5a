"""The error on actuators drawn at random, against LSODA of SciPy at a relative tolerance of 1e-12.

Three decades each of stiffness, mass, voltage, frequency of the drive; LuGre with and without a Stribeck
curve, Dahl and elastoplastic contacts; with and without reaction on the stage, external force and slope. The
equations are written here once more, from the papers.
"""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
from scipy.integrate import odeint

import stickslip as ss
from stickslip.study import Grid, Own, Study

if TYPE_CHECKING:  # a study's workers run this file by itself
    from .session import Row

ACTUATORS = 200
TOLERANCE = 1e-9  # m
PERIODS, SAMPLES = 3, 20
GAIN, STAGE_MASS, GRAVITY = 0.1057e-6, 0.0998, 9.80665
LUGRE, DAHL, ELASTOPLASTIC = 0, 1, 2


class Draw(NamedTuple):
    """An actuator with a LuGre, Dahl or elastoplastic contact and its sawtooth, SI."""

    law: int
    sigma_0: float
    sigma_1: float
    sigma_2: float
    coulomb: float
    stiction: float
    stribeck: float
    breakaway: float
    mass: float
    stage: float
    damping_ratio: float
    reaction: bool
    force: float
    incline: float
    amplitude: float
    frequency: float


def draw(number: int) -> Draw:
    """The actuator of this number."""
    rng = np.random.default_rng([2007, number])

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    law = int(rng.choice([LUGRE, LUGRE, DAHL, ELASTOPLASTIC]))
    sigma_0, mass, coulomb = between(3e4, 3e7), between(3e-3, 3.0), between(0.05, 5.0)
    stiction = coulomb * (1.0 + rng.uniform(0.0, 0.6) * rng.integers(2) * (law != DAHL))
    force = coulomb * rng.uniform(-0.3, 0.3) * rng.integers(2)
    slope = coulomb * rng.uniform(-0.3, 0.3) * rng.integers(2) / (mass * GRAVITY)
    return Draw(
        law=law,
        sigma_0=sigma_0,
        sigma_1=0.0 if law == DAHL else 2.0 * between(0.02, 0.5) * math.sqrt(sigma_0 * mass),
        sigma_2=0.0 if law == DAHL else between(1e-3, 1.0) * rng.integers(2),
        coulomb=coulomb,
        stiction=float(stiction),
        stribeck=between(3e-4, 1e-2),
        breakaway=rng.uniform(0.3, 0.9) * coulomb / sigma_0,
        mass=mass,
        stage=between(1e3, 3e4),
        damping_ratio=between(0.02, 0.7),
        reaction=bool(rng.integers(2)),
        force=float(force),
        incline=math.asin(float(np.clip(slope, -1.0, 1.0))),
        amplitude=between(0.1, 100.0),
        frequency=between(5.0, 5000.0),
    )


def model_of(d: Draw) -> tuple[ss.Actuator, ss.Sawtooth]:
    """The same for this package."""
    law: Any = ss.Dahl(sigma_0=d.sigma_0, coulomb_force=d.coulomb)
    shared = {
        "sigma_0": d.sigma_0,
        "sigma_1": d.sigma_1,
        "sigma_2": d.sigma_2,
        "coulomb_force": d.coulomb,
        "stiction_force": d.stiction,
        "stribeck_velocity": d.stribeck,
    }
    if d.law == LUGRE:
        law = ss.LuGre(**shared)
    elif d.law == ELASTOPLASTIC:
        law = ss.Elastoplastic(**shared, breakaway_deflection=d.breakaway)
    actuator = ss.Actuator(
        gain=GAIN,
        natural_frequency=d.stage,
        damping_ratio=d.damping_ratio,
        stage_mass=STAGE_MASS,
        end_effector_mass=d.mass,
        friction=law,
        stage_reaction=d.reaction,
        external_force=d.force,
        incline=d.incline,
    )
    return actuator, ss.Sawtooth(amplitude=d.amplitude, frequency=d.frequency)


@numba.njit(error_model="numpy")
def _rates(t, q, p, out):
    law, k, c, viscous, coulomb, stiction, stribeck, start, mass, stage, zeta, reaction, axial, slope = p
    y, w, s, z = q[0], q[1], q[3], q[4]
    v = w - s
    if law == DAHL:
        dz = v * (1.0 - k * z / coulomb * np.sign(v))
    else:
        end = (coulomb + (stiction - coulomb) * math.exp(-((v / stribeck) ** 2))) / k
        plastic = 1.0
        if law == ELASTOPLASTIC:
            if z * v <= 0.0 or abs(z) <= start:
                plastic = 0.0
            elif abs(z) < end:
                plastic = 0.5 + 0.5 * math.sin(math.pi * (abs(z) - 0.5 * (end + start)) / (end - start))
        dz = v - plastic * abs(v) * z / end
    friction = k * z + c * dz + viscous * v
    out[0] = w
    out[1] = (
        stage * stage * (GAIN * slope * t - y) - 2.0 * zeta * stage * w - reaction * friction / STAGE_MASS
    )
    out[2] = s
    out[3] = (friction + axial) / mass
    out[4] = dz


def reference(d: Draw, tolerance: float = 1e-12) -> np.ndarray:
    """Positions of the end-effector, m, SAMPLES per period and the first, from rest under its load."""
    axial = d.force - d.mass * GRAVITY * math.sin(d.incline)
    slope = d.amplitude * d.frequency
    p = (*map(float, d[:11]), float(d.reaction), axial, slope)
    y = d.reaction * axial / STAGE_MASS / d.stage**2
    q = np.array([y, 0.0, y, 0.0, -axial / d.sigma_0])
    times = np.linspace(0.0, 1.0 / d.frequency, SAMPLES + 1)
    absolute = tolerance * np.array([1e-6, 1e-3, 1e-6, 1e-3, max(1e-9, d.coulomb / d.sigma_0)])
    out = np.empty(5)

    def rates(t: float, q: np.ndarray) -> np.ndarray:
        _rates(t, q, p, out)
        return out

    parts = [q[2:3]]
    for _ in range(PERIODS):
        states = odeint(rates, q, times, rtol=tolerance, atol=absolute, tfirst=True, mxstep=10_000_000)
        q = states[-1].copy()
        parts.append(states[1:, 2])
    return np.concatenate(parts)


def error(d: Draw) -> tuple[float, int, float]:
    """Largest error of the position over the tolerance, steps, CPU seconds; any warning is an error."""
    model, drive = model_of(d)
    times = np.arange(PERIODS * SAMPLES + 1) / (SAMPLES * d.frequency)
    start = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ss.simulate(model, drive, times=times, tolerance=TOLERANCE)
    seconds = time.process_time() - start
    off = np.max(np.abs(found["end_effector_position"].values - reference(d)))
    return float(off / TOLERANCE), found.attrs["steps"] + found.attrs["rejected_steps"], seconds


def errors(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """`error` of actuators by their numbers, for a study."""
    found = np.array([error(draw(int(number))) for number in columns["number"]])
    return dict(zip(("off", "steps", "seconds"), found.T, strict=True))


def _row(number: int, off: float, steps: int, seconds: float) -> Row:
    d = draw(number)
    setting = ", ".join(f"{name} {value:.6g}" for name, value in d._asdict().items() if name != "law")
    return {
        "part": "accuracy",
        "problem": f"random actuator {number}",
        "tool": "stickslip",
        "method": "ss.simulate",
        "setting": setting,
        "law": ("LuGre", "Dahl", "Elastoplastic")[d.law],
        "error_over_tolerance": off,
        "max_error_m": off * TOLERANCE,
        "steps": steps,
        "cpu_ms_median": 1e3 * seconds,
    }


def measure_accuracy() -> tuple[list[Row], dict[str, str]]:
    """A row for each actuator."""
    study = Study(Grid({"number": np.arange(float(ACTUATORS))}), Own(errors), task=1)
    with tempfile.TemporaryDirectory() as folder:
        found = ss.run_study(study, f"{folder}/errors.zarr").load()
    assert not found.status.any(), found.reason.values
    columns = (found[name].values for name in ("off", "steps", "seconds"))
    rows = [_row(i, float(a), int(b), float(c)) for i, (a, b, c) in enumerate(zip(*columns, strict=True))]
    worst = max(rows, key=lambda row: row["error_over_tolerance"])
    print(f"accuracy: worst {worst['error_over_tolerance']:.3g} tolerances, {worst['problem']}")
    return rows, {name: version(name) for name in ("stickslip", "numba", "numpy", "scipy")}
