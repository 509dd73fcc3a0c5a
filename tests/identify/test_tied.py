"""Tied parameters in every kind of fit: recordings of known truth, and what was put in by hand beside."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import stickslip as ss
from stickslip.identify.events.pulled import PulledRig, simulated_force, slider
from stickslip.identify.walk.displacement import Displacement
from stickslip.identify.walk.explained import explained
from stickslip.identify.walk.walks import by_coordinates, columns_of, position_slopes
from stickslip.quantities.units import QuantityError
from stickslip.simulation.varied import with_values

from .frequency import modal_system
from .loops.test_inertia import driven
from .step_system import TRUTH, step_recording
from .stops import made_loops

DRIVE = ss.Sawtooth(65.0, 20.0, periods=3)
NOISE = 20e-9


EQUAL = {"stiction_force": "coulomb_force"}
TIED = {"sigma_1": "2 * 0.05 * sqrt(sigma_0 * end_effector_mass)"}


def actuator(sigma_0: float = 1.4e6, coulomb_force: float = 0.54) -> ss.Actuator:
    mass = 0.1
    law = ss.LuGre(sigma_0, 0.1 * np.sqrt(sigma_0 * mass), 0.0, coulomb_force, coulomb_force)
    return ss.load_actuator("kang2007").replace(stage_reaction=False, end_effector_mass=mass, friction=law)


@cache
def walk(noise: float = NOISE, seed: int = 0):
    shown = ss.simulate(actuator(), DRIVE, 0.15, sample_rate=4e3, tolerance=1e-10)
    random = np.random.default_rng(seed)
    shown["end_effector_position"] += noise * random.standard_normal(shown.sizes["time"])
    return shown[["end_effector_position"]].assign_attrs(title="walk")


@pytest.fixture(scope="module")
def tied_walk() -> ss.Fit:
    start = actuator(1e6, 0.7)
    return ss.identify_friction(
        walk(), start, ["sigma_0", "coulomb_force"], drive=DRIVE, tied=TIED, channel=()
    )


def test_a_walk_with_a_damping_ratio_that_is_known(tied_walk: ss.Fit) -> None:
    fit = tied_walk
    assert fit.converged
    assert [p.name for p in fit.parameters] == ["sigma_0", "coulomb_force"]
    assert fit.values["sigma_1"] == pytest.approx(0.1 * np.sqrt(0.1 * fit.values["sigma_0"]), rel=1e-12)
    assert fit.values["end_effector_mass"] == 0.1
    assert fit.model.friction.sigma_1 == fit.values["sigma_1"]
    truth = actuator().friction
    for name in ("sigma_0", "sigma_1", "coulomb_force"):
        low, high = fit.confidence_intervals(0.99)[name]
        assert low < getattr(truth, name) < high, name
    # A square root halves a relative error.
    relative = {name: fit.standard_errors[name] / fit.values[name] for name in ("sigma_0", "sigma_1")}
    assert relative["sigma_1"] == pytest.approx(0.5 * relative["sigma_0"], rel=1e-6)
    free = ss.identify_friction(
        walk(), actuator(), ["sigma_0", "sigma_1", "coulomb_force"], drive=DRIVE, channel=(), hops=0
    )
    assert fit.standard_errors["sigma_1"] < free.standard_errors["sigma_1"]


def test_its_derivatives_are_those_of_simulations(tied_walk: ss.Fit) -> None:
    fit = tied_walk
    motion = Displacement(walk(), DRIVE, "walk", fit.model, 1e-12)
    found = by_coordinates(columns_of(motion, fit, ["sigma_0", "coulomb_force"]), fit)
    assert fit.jacobian == pytest.approx(found, rel=1e-2, abs=1e-3 * np.abs(found).max())

    def position(values: dict[str, float]) -> np.ndarray:
        return motion.position(with_values(fit.model, fit.ties(values)), 0.0)

    own = {name: fit.values[name] for name in ("sigma_0", "coulomb_force")}
    for i, name in enumerate(own):
        up, down = (position({**own, name: own[name] * np.exp(h)}) for h in (1e-4, -1e-4))
        assert found[:, i] == pytest.approx(
            (up - down) / 2e-4, rel=1e-2, abs=2e-3 * np.abs(found[:, i]).max()
        )


def test_what_the_stage_is_off_moves_what_is_tied_to_it(tied_walk: ss.Fit) -> None:
    """Friction as a share of what carries the mass along: its derivative by the frequency has both ways."""
    tied = "0.072 * end_effector_mass * gain * '65 V' * natural_frequency ** 2"
    model = actuator()
    fit = ss.identify_friction(
        walk(), model, ["sigma_0"], drive=DRIVE, tied={"coulomb_force": tied}, channel=(), hops=0
    )
    motion = Displacement(walk(), DRIVE, "walk", model, 1e-12)
    omega = model.natural_frequency

    def position(at: float) -> np.ndarray:
        values = fit.ties({"sigma_0": fit.values["sigma_0"], "natural_frequency": at})
        return motion.position(with_values(model, values), 0.0)

    expected = (position(omega * 1.0001) - position(omega * 0.9999)) / (0.0002 * omega)
    found = position_slopes([motion], fit, ["natural_frequency"])[:, 0]
    assert found == pytest.approx(expected, rel=1e-2, abs=2e-3 * np.abs(expected).max())
    alone = position_slopes([motion], replace(fit, beside=()), ["natural_frequency"])[:, 0]
    assert np.abs(alone - expected).max() > 0.02 * np.abs(expected).max()


def test_a_profile_a_posterior_and_a_look_at_all_walks_keep_the_tie(tied_walk: ss.Fit) -> None:
    fit = tied_walk
    low, high = ss.identify.profile_interval(fit, walk(), "sigma_0", drive=DRIVE)
    linear = fit.confidence_intervals()["sigma_0"]
    assert (low, high) == pytest.approx(linear, rel=0.02)
    with pytest.raises(ss.estimate.FitError, match="'sigma_1' is unknown: there are sigma_0, coulomb_force"):
        ss.identify.profile_interval(fit, walk(), "sigma_1", drive=DRIVE)
    found = ss.posterior(fit, walk(), drive=DRIVE, max_simulations=2000)
    sigma_0, sigma_1 = (found.samples[name].values for name in ("sigma_0", "sigma_1"))
    assert sigma_1 == pytest.approx(0.1 * np.sqrt(0.1 * sigma_0), rel=1e-9)
    row = found.summary.sel(parameter="sigma_1")
    assert float(row["sd"]) == pytest.approx(fit.standard_errors["sigma_1"], rel=0.2)
    both = explained(fit, [walk(), walk(seed=1)], [DRIVE, DRIVE], ["sigma_0", "coulomb_force"])
    assert both.free.tied == both.known.tied == TIED
    assert not any(one.seen for one in both.lacks)


def test_a_profile_holds_a_value_that_bounds_what_is_tied_to_it() -> None:
    """No law has less stiction than Coulomb friction, on the way of the profile either."""
    random = np.random.default_rng(4)
    start = actuator(*random.uniform(0.7, 1.4, 2) * (1.4e6, 0.54))
    fit = ss.identify_friction(
        walk(), start, ["sigma_0", "coulomb_force", "offset"], drive=DRIVE, tied=EQUAL, channel=()
    )
    for name, linear in fit.confidence_intervals().items():
        if name not in EQUAL:
            found = ss.identify.profile_interval(fit, walk(), name, drive=DRIVE)
            width = linear[1] - linear[0]
            assert found == pytest.approx(linear, abs=0.1 * width)


def test_a_law_without_derivatives_has_ties_too() -> None:
    """One of two elements a third of the other."""
    law = ss.MaxwellSlip((3e5, 1e5), (0.3, 0.24))
    model = actuator().replace(friction=law)
    made = ss.simulate(model, DRIVE, 0.1, sample_rate=2e3, tolerance=1e-10)
    made["end_effector_position"] += NOISE * np.random.default_rng(0).standard_normal(made.sizes["time"])
    start = model.replace(friction=ss.MaxwellSlip((3.3e5, 1.1e5), (0.3, 0.24)))
    fit = ss.identify_friction(
        made[["end_effector_position"]].assign_attrs(title="two"),
        start,
        ["stiffness_1"],
        drive=DRIVE,
        tied={"stiffness_2": "stiffness_1 / 3"},
        channel=(),
    )
    assert fit.model.friction.stiffness == pytest.approx(law.stiffness, rel=0.01)
    assert fit.values["stiffness_2"] == pytest.approx(fit.values["stiffness_1"] / 3, rel=1e-12)


def test_loops() -> None:
    train = made_loops((4e4, 2e4), (1.2, 0.6), noise=0.01)
    start = ss.MaxwellSlip((2e4, 2e4), (0.8, 1.4))
    free = ["stiffness_1", "stiffness_2", "strength_1"]
    tied = {"strength_2": "0.5 * strength_1"}
    fit = ss.identify_loops(train, start, free, tied=tied, reference_normal_force=5.0, correlated=False)
    assert fit.converged
    assert fit.model.strength == pytest.approx((1.2, 0.6), rel=2e-3)
    assert fit.values["strength_2"] == 0.5 * fit.values["strength_1"]
    assert fit.standard_errors["strength_2"] == pytest.approx(0.5 * fit.standard_errors["strength_1"])
    assert ss.verify(fit, made_loops((4e4, 2e4), (1.2, 0.6), noise=0.01, seed=1)).r_squared > 0.999
    whole = [
        "stiffness_1",
        ss.estimate.Parameter("stiffness_2", 2e4, 1e3, 1e6, "N/m"),
        ss.estimate.Parameter("strength_1", 0.8, unit="N"),
        ss.estimate.Parameter("strength_2", unit="N", tied="0.5 * strength_1"),
        ss.estimate.Parameter("bias", 0.0, -0.1, 0.1, "N", log=False),
    ]
    same = ss.identify_loops(train, start, whole, reference_normal_force=5.0, correlated=False)
    assert {p.name: (p.lower, p.upper) for p in same.parameters}["bias"] == (-0.1, 0.1)
    assert same.model.strength == pytest.approx(fit.model.strength, rel=2e-3)
    bounds = {"bias": ("-1 mN", "1 mN")}
    near = ss.identify_loops(
        train, start, [*free, "bias"], tied=tied, bounds=bounds, reference_normal_force=5.0
    )
    assert -1e-3 <= near.values["bias"] <= 1e-3


def test_steps() -> None:
    """The lag of a sensor that is known beside the stage's own time: half the residual search."""
    recordings = [step_recording(v, 0.05e-6, seed) for seed, v in enumerate((60.0, 80.0))]
    ratio = TRUTH["lag"] * TRUTH["natural_frequency"]
    fit = ss.identify_step(recordings, tied={"lag": f"{ratio} / natural_frequency"})
    assert fit.values["lag"] == pytest.approx(TRUTH["lag"], rel=0.01)
    for name in ("damping_ratio", "natural_frequency", "lag"):
        low, high = fit.confidence_intervals(0.99)[name]
        assert low < TRUTH[name] < high, name
    alone = ss.identify_step(recordings)
    assert fit.standard_errors["natural_frequency"] < alone.standard_errors["natural_frequency"]
    with pytest.raises(QuantityError, match=r"'lags' cannot be tied \(did you mean 'lag'\?\)"):
        ss.identify_step(recordings, tied={"lags": "delay"})


def test_frequency_responses() -> None:
    """All modes damped in the ratios that they have: one damping ratio is left."""
    random = np.random.default_rng(2)
    drive = modal_system.multisines(random, 1000, 4)
    clean = modal_system.steady(drive)
    noisy = clean + 2e-9 * random.standard_normal(clean.shape)
    response = ss.identify.frequency_response(drive, noisy, modal_system.SAMPLE_RATE)
    tied = {"damping_ratio_2": "2.5 * damping_ratio_1", "damping_ratio_3": "1.5 * damping_ratio_1"}
    fit, free = ss.identify_frequency(response, 3, tied=tied), ss.identify_frequency(response, 3)
    assert fit.converged
    assert fit.model.damping_ratio == pytest.approx(modal_system.ZETA, rel=5e-3)
    assert fit.model.natural_frequency == pytest.approx(modal_system.OMEGA, rel=1e-3)
    assert fit.model.gain == pytest.approx(modal_system.GAIN, abs=1e-8)
    assert fit.standard_errors["damping_ratio_3"] < 0.8 * free.standard_errors["damping_ratio_3"]
    assert len(fit.parameters) == len(free.parameters) - 2
    # The coefficients' errors hold for a single search over everything as well.
    assert fit.standard_errors["gain_1[1,1]"] == pytest.approx(free.standard_errors["gain_1[1,1]"], rel=0.3)
    in_time = ss.identify.identify_in_time(
        drive, noisy, modal_system.SAMPLE_RATE, fit.model, periodic=True, tied=tied
    )
    assert in_time.values["damping_ratio_2"] == pytest.approx(2.5 * in_time.values["damping_ratio_1"])
    assert in_time.model.damping_ratio == pytest.approx(modal_system.ZETA, rel=2e-2)


def test_a_driven_mass() -> None:
    """Its offset known to be a fifth of its Coulomb friction."""
    fit = ss.identify.identify_inertia(driven(0), window=0.15, tied={"offset": "0.2 * coulomb_force"})
    free = ss.identify.identify_inertia(driven(0), window=0.15)
    assert fit.values["mass"] == pytest.approx(2.0, rel=0.02)
    assert fit.values["offset"] == pytest.approx(0.3, rel=0.1)
    assert fit.standard_errors["offset"] < free.standard_errors["offset"]
    with pytest.raises(QuantityError, match=r"offset \[N\] is tied to 'mass'"):
        ss.identify.identify_inertia(driven(0), window=0.15, tied={"offset": "mass"})


def test_a_pulled_slider() -> None:
    rig = PulledRig(0.03, 168.0, 1100e-6)
    made = simulated_force(slider(rig, 0.36, 0.3), rig)
    made["force_ratio"] += 5e-4 * np.random.default_rng(0).standard_normal(made.sizes["time"])
    fit = ss.identify.identify_pulled_slider(made, rig, tied={"stiction_excess": "0.2 * dynamic_coefficient"})
    assert fit.values["dynamic_coefficient"] == pytest.approx(0.3, rel=0.01)
    assert fit.values["stiction_excess"] == 0.2 * fit.values["dynamic_coefficient"]


@pytest.mark.parametrize(
    ("tied", "words"),
    [
        ({"sigma_3": "sigma_0"}, r"'sigma_3' cannot be tied \(did you mean 'sigma_\d'\?\): there are"),
        ({"sigma_0": "2 * sigma_0"}, r"'sigma_0' is free, and tied to '2 \* sigma_0'"),
        (
            {"sigma_1": "0.2 * sigma_O"},
            r"sigma_1 is tied to '0\.2 \* sigma_O', but there is no 'sigma_O' \(did",
        ),
        ({"sigma_1": "sigma_0"}, r"sigma_1 \[N s/m\] is tied to 'sigma_0', which is in newton / meter"),
        ({"sigma_1": "sigma_2", "sigma_2": "sigma_1"}, "tied in a circle: sigma_1 -> sigma_2 -> sigma_1"),
        ({"sigma_1": "open('x')"}, "is not one of: numbers, names"),
    ],
)
def test_wrong_ties_are_refused_before_any_simulation(tied: dict[str, str], words: str) -> None:
    with pytest.raises(QuantityError, match=words):
        ss.identify_friction(walk(), actuator(), ["sigma_0", "coulomb_force"], drive=DRIVE, tied=tied)


def parameters(**changes: object) -> list[ss.estimate.Parameter]:
    own = {
        "sigma_0": {"start": 1e6, "lower": 1e5, "upper": 1e7, "unit": "N/m"},
        "coulomb_force": {"start": 0.7, "unit": "N"},
        "sigma_1": {"unit": "N s/m", "tied": TIED["sigma_1"]},
    }
    return [ss.estimate.Parameter(name, **{**said, **changes.get(name, {})}) for name, said in own.items()]  # type: ignore[arg-type,dict-item]


def test_a_parameter_says_in_one_what_arguments_say() -> None:
    away = actuator(5e6, 0.2)  # the start is the Parameter's
    fit = ss.identify_friction(walk(), away, parameters(), drive=DRIVE, channel=())
    names, said = ["sigma_0", "coulomb_force"], {"bounds": {"sigma_0": (1e5, 1e7)}, "tied": TIED}
    same = ss.identify_friction(walk(), actuator(1e6, 0.7), names, drive=DRIVE, channel=(), **said)
    assert fit.values == pytest.approx(same.values, rel=1e-9)
    assert next((p.name, p.lower, p.upper) for p in fit.parameters) == ("sigma_0", 1e5, 1e7)
    again = ss.identify_friction(
        walk(), away, [*fit.parameters, parameters()[2]], drive=DRIVE, channel=(), hops=0
    )
    assert again.values == pytest.approx(fit.values, rel=1e-6)


def test_a_scale_that_is_linear_stays_so_and_so_does_the_prior_on_it() -> None:
    """By a line through the fit, and a normal distribution of the force itself."""
    random, names = np.random.default_rng(6), ["sigma_0", "coulomb_force"]
    prior = (0.54, float(random.uniform(1e-4, 3e-4)))
    told = {"drive": DRIVE, "noise": NOISE, "channel": (), "hops": 0}
    linear = [
        ss.estimate.Parameter("sigma_0", 1.3e6, unit="N/m", log=False),
        ss.estimate.Parameter("coulomb_force", 0.55, 0.2, 0.9, "N", log=False, prior=prior),
    ]
    fit = ss.identify_friction(walk(), actuator(), linear, **told)
    assert [(p.name, p.log) for p in fit.parameters] == [(name, False) for name in names]
    limits = [end for p in fit.parameters for end in (p.lower, p.upper)]
    assert limits == pytest.approx([1.3e6 / 30, 1.3e6 * 30, 0.2, 0.9])
    for name, (low, high) in fit.confidence_intervals().items():
        assert low + high == pytest.approx(2.0 * fit.values[name], rel=1e-12)
    alone = ss.identify_friction(walk(), actuator(), [p._replace(prior=None) for p in linear], **told)
    precision = np.linalg.inv(alone.covariance)
    held = precision + np.diag([0.0, prior[1] ** -2])
    own = [alone.values[name] for name in names]
    expected = np.linalg.solve(held, precision @ own + [0.0, prior[0] / prior[1] ** 2])
    errors = np.sqrt(np.diag(np.linalg.inv(held)))
    for name, value, error in zip(names, expected, errors, strict=True):
        assert fit.values[name] == pytest.approx(value, abs=0.1 * error)
        assert fit.standard_errors[name] == pytest.approx(error, rel=0.05)
    again = ss.identify_friction(walk(), fit.model, fit.parameters, **told)
    for one, other in zip(again.parameters, fit.parameters, strict=True):
        assert one._replace(start=other.start) == other


def test_a_fixed_parameter_keeps_its_value() -> None:
    one = ss.estimate.Parameter("coulomb_force", 0.54, unit="N", fixed=True)
    late = ss.estimate.Parameter("offset", 3e-9, unit="m", fixed=True)
    fit = ss.identify_friction(
        walk(), actuator(1.2e6, 0.6), ["sigma_0", one, late], drive=DRIVE, noise="20 nm", channel=(), hops=0
    )
    assert fit.model.friction.coulomb_force == fit.values["coulomb_force"] == 0.54
    assert fit.values["offset"] == 3e-9
    assert [p.name for p in fit.parameters] == ["sigma_0"]


@pytest.mark.parametrize(
    ("changes", "more", "reason"),
    [
        ({"sigma_0": {"unit": "N"}}, {}, r"sigma_0 is given in N, but is in N/m"),
        ({"sigma_0": {"upper": np.inf}}, {}, "sigma_0 has one bound: both are needed, or none"),
        ({}, {"bounds": {"sigma_0": (1e5, 1e6)}}, "sigma_0 is said of twice"),
        ({}, {"tied": TIED}, "sigma_1 is said of twice"),
        ({"coulomb_force": {"prior": (0.5, 0.1)}}, {}, "priors weigh against the noise"),
    ],
)
def test_a_parameter_that_cannot_be(changes: dict, more: dict, reason: str) -> None:
    with pytest.raises(QuantityError, match=reason):
        ss.identify_friction(walk(), actuator(), parameters(**changes), drive=DRIVE, **more)


def test_bounds_of_the_channel_are_taken_with_units() -> None:
    free = ["sigma_0", "offset"]
    bounds = {"offset": ("-20 nm", "30 nm"), "delay": ("-1 us", "1 us")}
    fit = ss.identify_friction(walk(), actuator(), free, drive=DRIVE, bounds=bounds, channel=(), hops=0)
    assert [(p.lower, p.upper) for p in fit.parameters if p.name == "offset"] == [(-20e-9, 30e-9)]
    with pytest.raises(QuantityError, match=r"lower bound of offset"):
        ss.identify_friction(walk(), actuator(), free, drive=DRIVE, bounds={"offset": ("1 s", 1.0)})
