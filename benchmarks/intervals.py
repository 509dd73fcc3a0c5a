"""Share of 95 % intervals that hold the truth, for fits and estimators that no other study covers.

Each draw has its own noise, and mostly its own truth: ``python -m benchmarks.intervals 40``; names behind the
number choose among the rates. The test suite keeps one draw of each, or a closed form.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from tests.control.test_estimator import KNOWN, truth
from tests.identify.events import test_pulled_scatter
from tests.identify.events.drawn import drawn_slider, drawn_walk
from tests.identify.frequency import modal_system, test_levels, test_modal, test_stage_response
from tests.identify.loops import test_alike
from tests.identify.piezo import records
from tests.identify.piezo.test_fit import noise_of
from tests.identify.walk import test_conditions, test_scales

from stickslip.control import Estimator
from stickslip.estimate.fit import fit_least_squares
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.problem import Residuals
from stickslip.estimate.quantiles import reach
from stickslip.estimate.result import Fit
from stickslip.estimate.systematic import intervals_with_systematics
from stickslip.friction import Dahl, MaxwellSlip
from stickslip.identify import identify_conditions, identify_frequency, identify_levels, identify_piezo
from stickslip.identify.events.mean_step import mean_step
from stickslip.identify.events.pulled import identify_pulled_slider
from stickslip.identify.events.sawtooth import sawtooth_features
from stickslip.identify.frequency.instruments import applied_voltage
from stickslip.identify.loops.fit import identify_loops
from stickslip.identify.walk.friction import identify_friction
from stickslip.physics.actuator import load_actuator
from stickslip.recording import make_recording
from stickslip.simulation import friction_response, simulate
from stickslip.waveform.periodic import Sawtooth

LEVEL = 0.95


def _holds(ends: dict[str, tuple[float, float]], true: dict[str, float]) -> list[bool]:
    return [ends[name][0] <= value <= ends[name][1] for name, value in true.items()]


def step_of_a_walk(seed: int, slips: int = 20) -> list[bool]:
    """Mean step of a drawn walk whose steps scatter by 3 %."""
    walk = drawn_walk(slips, seed, noise=5e-8, scatter=0.03, samples=100)
    found = sawtooth_features(walk).isel(walk=0)
    reached = float(found["net_step_error"]) * reach(LEVEL, float(found["net_step_freedom"]))
    return [abs(float(found["net_step"]) - 5e-6) < reached]


def step_of_peaks(seed: int) -> list[bool]:
    """Mean of steps that scatter by a tenth, from peaks with three times that noise; three are missing."""
    random = np.random.default_rng(seed)
    peaks = np.cumsum(1.0 + 0.1 * random.standard_normal(25)) + 0.3 * random.standard_normal(25)
    kept = np.delete(np.arange(25), [4, 11, 12])
    step, error = mean_step(np.diff(peaks[kept]), np.diff(kept).astype(float))
    return [abs(step - 1.0) < error * reach(LEVEL, kept.size - 3)]


def slider_that_scatters(seed: int) -> list[bool]:
    """Coefficients of a pulled slider whose stiction scatters by 3 % from event to event."""
    shown = drawn_slider(test_pulled_scatter.RIG, 0.4, 0.3, 30, seed, scatter=0.03, noise=1e-3)
    fit = identify_pulled_slider(shown, test_pulled_scatter.RIG)
    return _holds(fit.confidence_intervals(), {"stiction_excess": 0.1, "dynamic_coefficient": 0.3})


def poles_of_a_mirror(seed: int) -> list[bool]:
    """Natural frequencies and damping ratios of three modes."""
    starts = list(zip(modal_system.OMEGA / (2 * np.pi), modal_system.ZETA, strict=True))
    response = test_modal.measured(np.random.default_rng(seed), 2e-8, samples=1000)
    true = {f"natural_frequency_{m + 1}": float(modal_system.OMEGA[m]) for m in range(3)}
    true |= {f"damping_ratio_{m + 1}": float(modal_system.ZETA[m]) for m in range(3)}
    return _holds(identify_frequency(response, starts).confidence_intervals(), true)


def modes_over_the_amplitude(seed: int) -> list[bool]:
    """Slopes of natural frequencies and damping ratios, and the exponent of the amplitude."""
    of = test_levels.random_truth(np.random.default_rng(13))
    responses = test_levels.measured(of, np.random.default_rng(seed), (0.1, 0.2, 0.4), noise=3e-9)
    starts = list(zip(of.omega / (2 * np.pi), of.zeta, strict=True))
    true = {"exponent": of.exponent, "delay": of.delay}
    true |= {f"natural_frequency_slope_{m + 1}": float(of.softening[m]) for m in range(3)}
    true |= {f"damping_ratio_slope_{m + 1}": float(of.loss[m]) for m in range(3)}
    return _holds(identify_levels(responses, starts).confidence_intervals(), true)


@cache
def _stage(way: str) -> list[Any]:
    bench = test_stage_response.BENCH
    runs = getattr(test_stage_response, way)()
    rate, load = test_stage_response.RATE, bench.piezo_capacitance
    return [(applied_voltage(u, rate, bench.amplifier, load), x) for u, x in runs]


def stage_on_the_rig(seed: int, way: str) -> list[bool]:
    """Mode and gain of the clamped stage on the virtual rig."""
    noisy = test_stage_response.noisy(_stage(way), seed)
    if way == "noise_driven":
        fit = test_stage_response.by_segments(noisy)
    else:
        period = test_stage_response.PERIOD if way == "multisines" else test_stage_response.CHIRP
        fit = test_stage_response.by_periods(noisy, period)
    return _holds(fit.confidence_intervals(), test_stage_response.TRUTH)


def loops_with_memory(seed: int) -> list[bool]:
    """Dahl's law by loops whose noise remembers 0.8 of itself."""
    random = np.random.default_rng([17, seed])
    time = np.linspace(0.0, 1.0, 1500)
    position = 1e-5 * np.sin(6.0 * np.pi * time) * (1.0 + 0.5 * np.sin(2.0 * np.pi * time))
    force = random.uniform(0.2, 2.0)
    law = Dahl(force / (1e-5 * random.uniform(0.05, 0.4)), force)
    white = 0.6 * random.standard_normal(time.size + 50)
    noise = 0.01 * force * np.asarray(lfilter([1.0], [1.0, -0.8], white))[50:]
    shown = friction_response(law, time, position)["friction_force"].values + noise
    loops = make_recording(time, {"position": position, "friction_force": shown})
    fit = identify_loops(loops, Dahl(1.3 * law.sigma_0, 0.8 * force), ["sigma_0", "coulomb_force", "bias"])
    true = {"sigma_0": law.sigma_0, "coulomb_force": force, "bias": 0.0}
    return _holds(fit.confidence_intervals(), true)


def loops_of_alike_elements(seed: int) -> list[bool]:
    """Maxwell slip of two elements, in either order."""
    start = MaxwellSlip((9e4, 3e5), (0.6, 0.5))
    fit = identify_loops(test_alike.loops(test_alike.LAW, seed), start, test_alike.FREE)
    first = 1 if fit.values["strength_1"] > fit.values["strength_2"] else 2
    order = ((0, first), (1, 3 - first))
    true = {f"{of}_{n}": getattr(test_alike.LAW, of)[i] for i, n in order for of in ("stiffness", "strength")}
    return _holds(fit.confidence_intervals(), true)


def gain_and_creep(seed: int) -> list[bool]:
    """Gain and creep of a piezo with hysteresis."""
    of = records.truth(seed)
    shown = records.recording(of, records.drive(seed), noise_of(of), seed)
    fit = identify_piezo(shown, operators=records.PLAYS, asymmetric=True, creep=True)
    return _holds(fit.confidence_intervals(), {"gain": of.gain, "creep": of.creep})


def scale_of_the_sensor(seed: int) -> list[bool]:
    """Gain and friction where the scale of the position is known to 3 %."""
    random, position = np.random.default_rng(seed), test_scales.POSITION
    walk = simulate(test_scales.MODEL, test_scales.DRIVE, 0.2, sample_rate=5e3)
    noise = random.normal(0.0, test_scales.NOISE, walk.sizes["time"])
    one = test_scales.scaled(
        walk.assign({position: walk[position] + noise}), 1.0 + test_scales.SHARE * random.standard_normal()
    )
    fit = identify_friction(one, test_scales.MODEL, test_scales.HOMOGENEOUS, **test_scales.QUICK)
    true = {"gain": test_scales.MODEL.gain, "coulomb_force": test_scales.MODEL.friction.coulomb_force}
    return _holds(intervals_with_systematics(fit), true)


def offset_in_drift(seed: int) -> list[bool]:
    """Offset of a walk beside a drift that a recording at rest shows."""

    def drifting(count: int) -> NDArray[np.float64]:
        return 120e-9 * random.standard_normal(count) + np.cumsum(0.3e-9 * random.standard_normal(count))

    random, time, drive = np.random.default_rng(seed), np.arange(3000) / 2e3, Sawtooth(95.0, 50.0)
    model = load_actuator("kang2007").replace(stage_reaction=False)
    x = simulate(model, drive, times=time, tolerance=1e-11)["end_effector_position"].values
    walk = make_recording(time, {"end_effector_position": x + drifting(time.size)})
    rest = make_recording(np.arange(20_000) / 2e3, {"end_effector_position": drifting(20_000)})
    fit = identify_friction(walk, model, ["gain"], drive=drive, noise=rest, channel=("offset",), hops=0)
    return _holds(fit.confidence_intervals(), {"offset": 0.0})


def conditions_alike(seed: int) -> list[bool]:
    """One set of values explains walks at three temperatures between which nothing moves."""
    walks = [test_conditions.walk(10 * seed + i, c, 0.0) for i, c in enumerate((20.0, 30.0, 40.0))]
    found = identify_conditions(
        walks, test_conditions.KANG, test_conditions.FREE, "temperature", **test_conditions.OPTIONS
    )
    return [found.chance > 1.0 - LEVEL]


def decay(seed: int, memory: float) -> list[bool]:
    """Height and rate of an exponential decay, in white noise or in noise that remembers."""
    t = np.linspace(0.0, 2.0, 600)
    noise = lfilter([1.0], [1.0, -memory], 0.05 * np.random.default_rng(seed).standard_normal(t.size + 100))
    y = 2.0 * np.exp(-1.5 * t) + np.asarray(noise)[100:]
    free = [Parameter("height", 1.0, 1e-3, 1e3), Parameter("rate", 1.0, 1e-3, 1e3)]
    part = Residuals(lambda v: v["height"] * np.exp(-v["rate"] * t) - y, y)
    fit: Fit = fit_least_squares([part], free, correlated=memory > 0.0)
    return _holds(fit.confidence_intervals(), {"height": 2.0, "rate": 1.5})


def band_of_steps(seed: int) -> list[bool]:
    """Position of a motor after 60 steps forward and 30 backward, without a sensor."""
    directions = np.array([1] * 40 + [-1] * 30 + [1] * 20)
    one = Estimator(KNOWN)
    for direction in directions.tolist():
        one.stepped(direction)
    low, high = one.band(LEVEL)
    return [bool(low < truth(np.random.default_rng(seed), directions)[-1] < high)]


RATES: dict[str, Callable[[int], list[bool]]] = {
    "step_of_a_walk": step_of_a_walk,
    "step_of_peaks": step_of_peaks,
    "slider_that_scatters": slider_that_scatters,
    "poles_of_a_mirror": poles_of_a_mirror,
    "modes_over_the_amplitude": modes_over_the_amplitude,
    **{
        f"stage_by_{way}": partial(stage_on_the_rig, way=way)
        for way in ("multisines", "chirps", "noise_driven")
    },
    "loops_with_memory": loops_with_memory,
    "loops_of_alike_elements": loops_of_alike_elements,
    "gain_and_creep": gain_and_creep,
    "scale_of_the_sensor": scale_of_the_sensor,
    "offset_in_drift": offset_in_drift,
    "conditions_alike": conditions_alike,
    "decay_in_white_noise": partial(decay, memory=0.0),
    "decay_in_noise_that_remembers": partial(decay, memory=0.9),
    "band_of_steps": band_of_steps,
}


def main(draws: int, names: Iterable[str]) -> None:
    """Print how many intervals held."""
    for name in names or RATES:
        held = [one for seed in range(draws) for one in RATES[name](seed)]
        print(f"{name:32} {sum(held):5d} of {len(held):5d}  {np.mean(held):.3f}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
