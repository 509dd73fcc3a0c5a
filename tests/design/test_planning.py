"""Planned experiments: the expected covariance by other routes, and that fits then scatter as expected."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray

import stickslip as ss
from stickslip.design import FreeDrives, Plan, planning
from stickslip.design.candidates import there_and_back
from stickslip.design.information import FitSpace, covariance, seen
from stickslip.estimate.coloured import Coloured
from stickslip.estimate.parameter import Parameter
from stickslip.estimate.tied import Ties
from stickslip.identify import PlannedWalk
from stickslip.quantities.input_file import load_yaml
from stickslip.quantities.units import QuantityError
from stickslip.rig import Limits
from stickslip.simulation import steady_step_derivatives
from stickslip.waveform import Rest, Sequence

Array = NDArray[np.float64]

ACTUATOR = ss.load_actuator("kang2007").replace(stage_reaction=False)
FREE = ["sigma_0", "sigma_1", "coulomb_force"]
NOISE, RATE = 100e-9, 2e3
LIMITS = Limits(max_voltage=100.0, min_position=-200e-6, max_position=400e-6)
FEW = {
    "slow": ss.Sawtooth(65.0, 5.0),
    "fast": there_and_back(100.0, 97.0, 1.0, 0.4),
    "faster": there_and_back(80.0, 197.0, 0.8, 0.4),
    "triangle": ss.waveform.Triangle(60.0, 23.0),
}


def planned(candidates: Any = FEW, **how: Any) -> Plan:
    given: dict[str, Any] = {"free": FREE, "noise": NOISE, "duration": 0.4, "recordings": 2, "limits": LIMITS}
    return ss.plan_experiment(how.pop("model", ACTUATOR), candidates, **(given | how))


def space(model: ss.Actuator, names: list[str]) -> FitSpace:
    """With delay and offset."""
    of = model._asdict() | model.friction._asdict()
    own = [Parameter(n, of[n], 0.0) for n in names]
    more = [Parameter("delay", 0.0, log=False), Parameter("offset", 0.0, log=False)]
    return FitSpace((*own, *more), Ties([*own, *more]))


def position(model: ss.Actuator, drive: Any, times: Array, delay: float = 0.0) -> Array:
    later = np.append(0.0, np.maximum(times[1:] - delay, 1e-12))
    return ss.simulate(model, drive, times=later, tolerance=1e-12).end_effector_position.values


def recorded(plan: Plan, count: int) -> Iterator[tuple[list[xr.Dataset], list[Any]]]:
    """So many times the recordings of a plan with white noise, and their drives."""
    walks = [(n, w, position(ACTUATOR, w.drive, w.times)) for n, w in plan.recordings.items()]
    for seed in range(count):
        random, made, drives = np.random.default_rng([seed, 11]), [], []
        for name, walk, x in walks:
            for repeat in range(walk.repeats):
                noisy = x + walk.noise * random.standard_normal(x.size)
                of = {"end_effector_position": noisy}
                made.append(ss.make_recording(walk.times, of, title=f"{name} {repeat}"))
                drives.append(walk.drive)
        yield made, drives


def test_information_is_that_of_differences() -> None:
    names = ["sigma_0", "sigma_1", "coulomb_force", "natural_frequency", "damping_ratio", "gain"]
    model = ACTUATOR.replace(end_effector_mass=0.08)
    walk = PlannedWalk(FEW["faster"], 0.2, RATE, NOISE, repeats=3)
    t = walk.times
    columns = []
    for name in names:
        sides = []
        for h in (1e-4, -1e-4):
            law = model.friction
            if name in law._fields:
                changed = {name: getattr(law, name) * (1.0 + h)}
                if name == "coulomb_force":  # stiction keeps its ratio
                    changed["stiction_force"] = changed[name]
                moved = model.replace(friction=law._replace(**changed))
            else:
                moved = model.replace(**{name: getattr(model, name) * (1.0 + h)})
            sides.append(position(moved, walk.drive, t))
        columns.append((sides[0] - sides[1]) / 2e-4)
    columns.append((position(model, walk.drive, t, 1e-6) - position(model, walk.drive, t, 0.0)) / 1e-6)
    columns.append(np.ones(t.size))
    j = np.column_stack(columns)
    found = seen(model, walk, "one", space(model, names), ss.recording.Chain(), None)
    norms = np.sqrt(np.diag(found.normal))
    assert np.abs(found.normal / np.outer(norms, norms) - 3.0 * j.T @ j / np.outer(norms, norms)).max() < 5e-3
    assert np.allclose(found.spread, NOISE**2 * found.normal)
    assert found.duration == pytest.approx(0.6)
    one = np.sqrt(np.diag(covariance(found)))
    other = NOISE * np.sqrt(np.diag(np.linalg.inv(3.0 * j.T @ j)))
    assert one[:6] == pytest.approx(other[:6], rel=0.02)


def test_fit_knows_what_was_expected() -> None:
    plan = planned(recordings=1, duration=1.0)
    recordings, drives = next(recorded(plan, 1))
    fit = ss.identify_friction(
        recordings, ACTUATOR, FREE, drive=drives, channel=("delay", "offset"), hops=0, noise=NOISE
    )
    for name, expected in plan.standard_errors.items():
        assert fit.standard_errors[name] == pytest.approx(expected, rel=0.06), name
    found = fit.correlation.sel(parameter=FREE, other=FREE).values
    assert found == pytest.approx(plan.correlation.values, abs=0.03)


def test_goal_of_a_use_is_the_scatter_of_its_prediction() -> None:
    use = ss.Sawtooth(65.0, 20.0)
    plan = planned(goal=use, recordings=1)
    random = np.random.default_rng(4)
    values = np.array([getattr(ACTUATOR.friction, name) for name in FREE])
    errors = np.array([plan.standard_errors[name] for name in FREE]) / values
    spread = 1e-4 * plan.correlation.values * np.outer(errors, errors)  # so small that all is linear
    drawn = values * np.exp(random.multivariate_normal(np.zeros(3), spread, 400))
    members = {name: drawn[:, i] for i, name in enumerate(FREE)} | {"stiction_force": drawn[:, 2]}
    steps = ss.steady_steps(ACTUATOR, use, parameters=members).net_step.values
    of = plan.dataset
    alone = of["gain"].values[of["taken"].values > 0][0]
    best = float(of["gain"].max())
    assert alone == best
    by_draws = 100.0 * np.std(steps) / np.mean(steps)
    by_other = {}
    for name, drive in FEW.items():
        one = planned({name: drive}, goal=use, recordings=1)
        by_other[name] = float(one.dataset["gain"][0])
    assert max(by_other, key=lambda n: by_other[n]) in plan.recordings
    by = steady_step_derivatives(ACTUATOR, use, parameters=FREE)
    g = np.array([by[name] for name in FREE]) * values / ss.steady_step(ACTUATOR, use)
    assert by_draws == pytest.approx(100.0 * np.sqrt(g @ (1e4 * spread) @ g) * 1e-2, rel=0.12)


def test_one_parameter_is_known_best_by_its_own_plan() -> None:
    every = planned(recordings=1)
    for name in FREE:
        own = planned(recordings=1, goal=name)
        best = own.dataset["alone"].sel(parameter=name).min()
        assert own.standard_errors[name] <= every.standard_errors[name] * (1.0 + 1e-12)
        assert float(own.dataset["half_width"].sel(parameter=name)) == pytest.approx(float(best))


def test_draws_of_a_model_are_followed() -> None:
    stiffness = 1.399e6 * np.array([0.5, 2.0])
    plan = planned(draws={"sigma_0": stiffness}, recordings=1)
    one = planned(recordings=1)
    assert np.all(plan.dataset["worst_half_width"] >= plan.dataset["half_width"] * (1.0 - 1e-12))
    assert np.array_equal(one.dataset["worst_half_width"], one.dataset["half_width"])
    worst = []
    for value in (1.399e6, *stiffness):
        model = ACTUATOR.replace(friction=ACTUATOR.friction._replace(sigma_0=value))
        alone = planned(FEW, model=model, recordings=1).dataset["alone"]
        worst.append(alone.sel(candidate=next(iter(plan.recordings))).values)
    assert plan.dataset["worst_half_width"].values == pytest.approx(np.max(worst, axis=0))


def test_equal_time_is_compared() -> None:
    plan = planned({"slow": ss.Sawtooth(65.0, 5.0)}, default=ss.Sawtooth(65.0, 5.0), recordings=3)
    assert plan.duration == pytest.approx(1.2)
    assert next(iter(plan.recordings.values())).repeats == 3
    assert plan.dataset["narrower"].values == pytest.approx(1.0)
    assert plan.dataset["gain"].values == pytest.approx(1.0)
    expected = plan.dataset["expected"].values
    assert expected[2] == pytest.approx(expected[0] / np.sqrt(3.0))


@pytest.mark.parametrize("duration", [0.25])
def test_one_s_own_default_lasts_as_long_as_the_candidates(duration: float) -> None:
    """It was lengthened to two periods of 5 Hz, with a rest that counted as information."""
    drive = ss.Sine(30.0, 50.0, offset=30.0, periods=10)
    plan = planned({"sine": drive}, default=drive, duration=duration, recordings=1)
    assert plan.dataset["narrower"].values == pytest.approx(1.0)


def test_grid_tells_more_than_the_default_within_its_limits() -> None:
    slew = 2.0e5
    plan = planned(None, chain=ss.recording.Chain(slew_rate=slew), recordings=2)
    assert np.all(plan.dataset["narrower"] > 5.0)
    for name, walk in plan.recordings.items():
        t = np.arange(0.0, walk.duration, 1e-5)
        u = ss.simulate(ACTUATOR, walk.drive, times=t).drive_voltage.values
        assert u.min() >= 0.0
        assert u.max() <= 100.0 + 1e-9
        assert np.abs(np.diff(u)).max() <= slew * 1e-5 * (1.0 + 1e-6), name
        x = position(ACTUATOR, walk.drive, t)
        assert x.min() >= -200e-6
        assert x.max() <= 400e-6
    assert f"these {sum(w.repeats for w in plan.recordings.values())} recordings" in plan.report()
    assert plan.table.loc["sigma_1", "unit"] == "N s/m"


def test_recording_at_rest_gives_its_noise() -> None:
    random = np.random.default_rng(6)
    n = 8000
    x = NOISE * random.standard_normal(n)
    smooth = np.convolve(np.append(np.zeros(3), x), [0.5, 0.5, 0.5, 0.5], "valid")  # the same level, slower
    rest = ss.make_recording(np.arange(n) / RATE, {"end_effector_position": x})
    slow = ss.make_recording(np.arange(n) / RATE, {"end_effector_position": smooth})
    white, known, late = planned(), planned(noise=rest), planned(noise=slow)
    errors = [np.array([one.standard_errors[name] for name in FREE]) for one in (white, known, late)]
    assert errors[1] == pytest.approx(errors[0], rel=0.03)
    assert np.any(np.abs(errors[2] / errors[0] - 1.0) > 0.2)
    with pytest.raises(QuantityError, match="at rest has 2000 Hz, and sample_rate is 1000 Hz"):
        planned(noise=rest, sample_rate=1e3)


def test_fit_brings_its_noise_rate_and_values() -> None:
    drive = FEW["fast"]
    t = np.arange(801) / RATE
    x = position(ACTUATOR, drive, t) + NOISE * np.random.default_rng(7).standard_normal(t.size)
    record = ss.make_recording(t, {"end_effector_position": x})
    fit = ss.identify_friction(
        record,
        ACTUATOR,
        FREE[:2],
        drive=drive,
        channel=("offset",),
        hops=0,
        tied={"coulomb_force": "'0.5401 N'"},
    )
    plan = ss.plan_experiment(fit, FEW, duration=0.4, recordings=1, limits=LIMITS, draws=3, seed=1)
    assert list(plan.dataset["parameter"].values) == FREE[:2]
    assert plan.dataset["value"].values == pytest.approx([fit.values[n] for n in FREE[:2]])
    walk = next(iter(plan.recordings.values()))
    assert walk.sample_rate == pytest.approx(RATE)
    assert walk.noise == pytest.approx(NOISE, rel=0.1)
    assert np.all(plan.dataset["worst_half_width"] >= plan.dataset["half_width"] * (1.0 - 1e-12))
    for other, how, said in (
        (fit, {"free": FREE}, "'coulomb_force' is fixed or tied in the fit"),
        (replace(fit, observed="piezo_elongation"), {}, "the fit is of piezo_elongation"),
        (replace(fit, model=ACTUATOR.friction), {}, "not from a fit of LuGre"),
    ):
        with pytest.raises(QuantityError, match=said):
            ss.plan_experiment(other, FEW, **how)


def test_tied_values_move_together() -> None:
    """sigma_1 = c sqrt(sigma_0): the plan for sigma_0 alone then is that along both."""
    drive, names = FEW["fast"], ["sigma_0", "sigma_1"]
    walk = PlannedWalk(drive, 0.4, RATE, NOISE)
    both = seen(ACTUATOR, walk, "one", space(ACTUATOR, names), ss.recording.Chain(), None).normal
    free = Parameter("sigma_0", 1.399e6, 0.0)
    follows = Parameter("sigma_1", tied=f"{34.9 / math.sqrt(1.399e6)!r} * sqrt(sigma_0)", unit="")
    found = seen(
        ACTUATOR, walk, "one", FitSpace((free,), Ties([free, follows])), ss.recording.Chain(), None
    ).normal
    along = np.array([1.0, 0.5])
    assert found[0, 0] == pytest.approx(along @ both[:2, :2] @ along, rel=1e-6)


def test_a_free_drive_tells_more_and_comes_back(tmp_path: Path) -> None:
    how: dict[str, Any] = {
        "free": FREE,
        "noise": NOISE,
        "duration": 0.2,
        "sample_rate": RATE,
        "recordings": 1,
    }
    limits = Limits(max_voltage=80.0, min_position=-200e-6, max_position=400e-6)
    usual = ss.plan_experiment(ACTUATOR, goal="sigma_0", limits=limits, **how)
    free = ss.plan_experiment(ACTUATOR, FreeDrives(5, trials=48), goal="sigma_0", limits=limits, **how)
    ((name, walk),) = free.recordings.items()
    assert name.startswith("free drive")
    assert free.standard_errors["sigma_0"] < usual.standard_errors["sigma_0"]
    alone = planned({"it": walk}, goal="sigma_0", recordings=1)
    assert alone.standard_errors["sigma_0"] == pytest.approx(free.standard_errors["sigma_0"])
    low, high = walk.drive.range()
    assert low >= 0.0
    assert high <= 80.0
    moved = position(ACTUATOR, walk.drive, walk.times)
    forward = position(ACTUATOR, walk.drive.parts[0][0]._replace(periods=None), walk.times)
    assert abs(moved[-1]) < 0.3 * abs(forward[-1]), "it walks back as well"
    content = load_yaml(free.save(tmp_path / "free.yaml"))
    shapes = {part["shape"] for part in content["runs"][0]["waveform"]}
    assert shapes == {"PeriodicKnots"}
    with pytest.raises(QuantityError, match="knots"):
        FreeDrives(2)
    with pytest.raises(QuantityError, match="whole number"):
        FreeDrives(4.5)


def test_a_free_drive_is_searched_for_at_draws_too(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[tuple[str, float]] = []

    def noted(model: ss.Actuator, walk: PlannedWalk, name: str, *more: Any) -> Any:
        tried.append((name, model.friction.sigma_0))
        return seen(model, walk, name, *more)

    monkeypatch.setattr(planning, "seen", noted)
    draws = {"sigma_0": [1.0e6, 1.2e6, 1.6e6, 1.8e6]}
    planned(FreeDrives(3, trials=16), duration=0.1, recordings=1, goal="sigma_0", draws=draws)
    assert {x for name, x in tried if name == "free drive"} == {1.399e6, *draws["sigma_0"][:3]}


def test_what_no_candidate_tells_is_left_out_of_the_goal() -> None:
    """With a stiction force of the Coulomb force no motion depends on the Stribeck velocity."""
    without, plan = planned(), planned(free=[*FREE, "stribeck_velocity"])
    assert plan.undetermined == ("stribeck_velocity",)
    assert list(plan.recordings) == list(without.recordings)
    wider = plan.dataset.half_width.sel(parameter=FREE).values / without.dataset.half_width.values
    np.testing.assert_allclose(wider, 1.0, rtol=1e-6, err_msg="rounding tied one more to the others")
    assert plan.dataset.half_width.sel(parameter="stribeck_velocity") > 100.0
    assert "Not determined by any candidate: stribeck_velocity." in plan.report()
    assert "not told" in plan.report()
    with pytest.raises(QuantityError, match="stribeck_velocity cannot be determined"):
        planned(free=[*FREE, "stribeck_velocity"], goal="stribeck_velocity")


def test_drives_begin_at_rest() -> None:
    plan = planned(recordings=2)
    drives = plan.drives("0.1 s")
    walk = next(iter(plan.recordings.values()))
    assert isinstance(drives[0], Sequence)
    assert drives[0].parts[0] == (Rest(0.1), 0.1)
    assert drives[0].duration == pytest.approx(0.1 + walk.duration)
    assert len(drives) == sum(w.repeats for w in plan.recordings.values())


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"candidates": {}}, "candidates"),
        ({"candidates": {"x": ss.Sawtooth(1e-6, 5.0, unit="m")}}, "waveform in V"),
        ({"free": None}, "free"),
        ({"goal": "sigma_2"}, "goal"),
        ({"goal": ss.waveform.Triangle(1.0, 5.0)}, "no net step"),
        ({"noise": None}, "noise"),
        ({"recordings": math.nan}, "recordings"),
        ({"channel": ("scale",)}, "scale"),
        ({"draws": 5}, "nothing to draw from"),
        ({"draws": {"sigma_4": [1.0]}}, "another model"),
        ({"draws": {"sigma_0": [1e6], "sigma_1": [30.0, 40.0]}}, "as many values"),
        ({"free": ["stribeck_velocity"]}, "stribeck_velocity"),
        ({"model": ACTUATOR.replace(min_voltage=20.0), "limits": None}, "model's voltage range, 20 V"),
        ({"limits": Limits(max_voltage=10.0)}, "no candidate can be taken"),
        ({"limits": Limits(max_slew=1001.0)}, "V/s"),
        ({"limits": Limits(max_duty=0.1)}, "10 %"),
        ({"limits": Limits(min_position=-1e-9, max_position=1e-9)}, "allowed"),
        ({"model": ACTUATOR.replace(clamped=True)}, "no derivatives"),
        ({"candidates": {"fast": ss.Sawtooth(65.0, 900.0)}}, "coarsely sampled"),
    ],
)
def test_refusals_name_what_is_wrong(how: dict[str, Any], said: str) -> None:
    with pytest.raises(QuantityError, match=said):
        planned(**how)


def test_zeros_of_recordings_are_one_more_error() -> None:
    """Against the matrix of the noise: each recording is moved by the mean of its 200 samples at rest."""
    names = ["sigma_0", "coulomb_force"]
    walk, of = PlannedWalk(FEW["fast"], 0.2, RATE, NOISE), space(ACTUATOR, names)
    by = walk.motion(ACTUATOR, "one").slopes(ACTUATOR, 0.0, names)
    j = np.column_stack([by, np.ones(len(by))]) * [p.slope(p.start) for p in of.parameters]
    at_rest = 200
    averaged = np.hstack([-np.full((len(j), at_rest), 1.0 / at_rest), np.eye(len(j))])
    step = 2e-9
    for colour, sigma in (
        (None, NOISE**2 * np.eye(at_rest + len(j))),
        (Coloured(np.array([NOISE**2, 0.3 * NOISE**2])), NOISE**2 * _banded(at_rest + len(j), 0.3)),
    ):
        found = seen(ACTUATOR, walk, "one", of, ss.recording.Chain(zeroed=True), colour).spread
        assert found == pytest.approx(j.T @ averaged @ sigma @ averaged.T @ j, rel=0.02)
    drifting = Coloured(np.array([NOISE**2]), step**2)
    drifts = seen(ACTUATOR, walk, "one", of, ss.recording.Chain(zeroed=True), drifting)
    i = np.arange(1, at_rest + len(j) + 1)
    sigma = NOISE**2 * np.eye(i.size) + step**2 * np.minimum(i[:, None], i)
    assert drifts.spread == pytest.approx(j.T @ averaged @ sigma @ averaged.T @ j, rel=0.05)


def _banded(n: int, beside: float) -> Array:
    return np.eye(n) + beside * (np.eye(n, k=1) + np.eye(n, k=-1))
