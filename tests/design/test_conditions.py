"""Drives under draws, other laws, other goals, and on the virtual rig; fronts."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest
import xarray as xr

import stickslip as ss
from stickslip import design
from stickslip.design import Scenario
from stickslip.design.front import selected, unbeaten
from stickslip.design.moving import PeriodicMotions
from stickslip.design.scenarios import conditions_of
from stickslip.estimate import Posterior
from stickslip.rig import VirtualRig, load_bench
from stickslip.simulation.varied import free_names

KANG = ss.load_actuator("kang2007")
exact = partial(ss.steady_step, tolerance=1e-11)


def posterior_of(**spread: float) -> Posterior:
    random, columns = np.random.default_rng(1), {}
    for name, share in spread.items():
        own = getattr(KANG.friction, name, None) or getattr(KANG, name, 1.0)
        columns[name] = (("chain", "draw"), own * np.exp(share * random.standard_normal((2, 100))))
    columns["delay"] = (("chain", "draw"), np.full((2, 100), 1e-3))
    return Posterior(xr.Dataset(columns), xr.Dataset(), True, "", 1.0)


def test_every_scenario_with_every_draw():
    known = posterior_of(coulomb_force=0.1, natural_frequency=0.02)
    cases = [Scenario("held", external_force="-0.1 N"), Scenario(factors={"natural_frequency": 0.9})]
    found = conditions_of(KANG, cases, known, 5, 3)
    assert len(found.names) == 3 * 6
    assert found.names[:4] == ("nominal", "held", "natural_frequency x 0.9", "draw 1")
    samples = known.samples
    for name, column in found.columns.items():
        assert column.shape == (18,)
        if name == "coulomb_force":
            assert set(column[3:]) <= set(samples.coulomb_force.values.ravel())
            assert np.all(column[:3] == KANG.friction.coulomb_force)
            assert column[3] == column[4] == column[5]
    assert found.columns["natural_frequency"][5] == pytest.approx(0.9 * found.columns["natural_frequency"][3])
    assert np.array_equal(found.columns["external_force"], np.tile([0.0, -0.1, 0.0], 6))
    assert (
        conditions_of(KANG, cases, known, 5, 3).columns["coulomb_force"][4]
        == found.columns["coulomb_force"][4]
    )


@pytest.mark.parametrize(
    "model",
    [
        KANG,
        ss.load_actuator("kang2007-hysteresis"),
        KANG.replace(friction=ss.MaxwellSlip((1e6, 2e6), (0.2, 0.3))),
    ],
    ids=lambda model: type(model.friction).__name__ + type(model.piezo).__name__,
)
def test_every_name_of_a_model_is_a_factor_of_a_scenario(model):
    for name in free_names(model):
        factor = 0.99 if name.endswith("stiffness_exponent") else 1.01  # its own value is the greatest
        found = conditions_of(model, [Scenario(factors={name: factor})], None, 0, 0).columns[name]
        assert found[1] == pytest.approx(factor * found[0])


def test_robust_over_draws_is_worse_nowhere():
    found = ss.optimise_waveform(
        KANG,
        goal="speed",
        max_voltage=100.0,
        scenarios=[Scenario(external_force="-0.1 N")],
        uncertainty=posterior_of(coulomb_force=0.1, sigma_0=0.2),
        draws=2,
        budget=500,
    )
    assert found.values.shape == (6,)
    assert not found.fell_back
    assert np.all(found.values >= found.sawtooth_values - 1e-8)
    assert found.value == found.values.min()
    assert found.value > found.sawtooth_value
    worst = int(np.argmin(found.values))
    column = {name: float(of[worst]) for name, of in found.conditions.columns.items()}
    law = KANG.friction._replace(
        coulomb_force=column["coulomb_force"],
        stiction_force=column["coulomb_force"],
        sigma_0=column["sigma_0"],
    )
    loaded = KANG.replace(friction=law, external_force=column["external_force"])
    assert found.value == pytest.approx(exact(loaded, found.waveform) * found.frequency, rel=1e-4)


@pytest.mark.parametrize("given", [{"load": math.inf}, {"factors": {"gain": math.nan}}])
def test_a_scenario_is_of_finite_numbers(given):
    with pytest.raises(ss.QuantityError, match=next(iter(given))):
        conditions_of(KANG, [Scenario(**given)], None, 1, 0)


def test_an_uncertainty_of_another_model_is_refused():
    other = KANG.replace(friction=ss.Coulomb(coulomb_force=0.5))
    with pytest.raises(ss.QuantityError, match="of another model: it has 'sigma_0'"):
        ss.optimise_waveform(
            other, goal="speed", max_voltage=100.0, uncertainty=posterior_of(coulomb_force=0.1, sigma_0=0.2)
        )
    with pytest.raises(ss.QuantityError, match="uncertainty=posterior"):
        ss.optimise_waveform(posterior_of(sigma_0=0.1), goal="speed")
    with pytest.raises(ss.QuantityError, match="no parameter of the actuator"):
        ss.optimise_waveform(KANG, goal="speed", max_voltage=100.0, uncertainty=posterior_of())


LAWS = (
    ss.Coulomb(coulomb_force=0.6),
    ss.Elastoplastic(1.4e6, 34.9, 0.0, 0.54, 0.6, 0.2e-6),
)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_other_laws(law):
    random = np.random.default_rng(3)
    model = KANG.replace(
        friction=law,
        natural_frequency=3303.1 * random.uniform(0.8, 1.5),
        damping_ratio=random.uniform(0.2, 0.6),
        end_effector_mass=random.uniform(0.05, 0.15),
    )
    found = ss.optimise_waveform(model, goal="speed", max_voltage=80.0, budget=100)
    assert found.value >= found.sawtooth_value > 1e-3
    finely = ss.steady_step(model, found.waveform, tolerance=1e-9)
    assert found.value == pytest.approx(finely * found.frequency, rel=1e-3)


LOADS = [Scenario(external_force=force) for force in (-0.15, -0.1, 0.1, 0.15)]


def test_a_quantile_gives_the_worst_up():
    """Half of the conditions may do worse: the other half then does better than in the worst case."""
    common = {"goal": "speed", "max_voltage": 100.0, "knots": 6, "budget": 200, "scenarios": LOADS}
    middle = ss.optimise_waveform(KANG, quantile=0.5, **common)
    assert middle.value == pytest.approx(np.median(middle.values))
    assert middle.sawtooth_value == pytest.approx(np.median(middle.sawtooth_values))
    assert np.all(middle.values >= middle.sawtooth_values - 1e-9), (
        "nowhere worse than the sawtooth, all the same"
    )
    assert "at the quantile 0.5 of 5 conditions" in middle.report()
    worst = ss.optimise_waveform(KANG, **common)
    assert worst.value == pytest.approx(worst.values.min())
    assert middle.value > np.median(worst.values)


def test_temperature_ageing_and_gravity_are_conditions_like_any_other():
    """Each is what it makes of the model's fields; the drive is judged under all of them together."""
    cases = {
        "warm": Scenario("warm", factors={"gain": 1.08, "coulomb_force": 0.9, "stiction_force": 0.9}),
        "worn": Scenario("worn", factors={"sigma_0": 0.7, "sigma_1": 1.3}),
        "steep": Scenario("steep", incline="3 deg"),
    }
    found = ss.optimise_waveform(
        KANG, goal="speed", max_voltage=100.0, knots=6, budget=100, scenarios=[*cases.values()]
    )
    law = KANG.friction
    models = {
        "nominal": KANG,
        "warm": KANG.replace(
            gain=1.08 * KANG.gain,
            friction=law._replace(
                coulomb_force=0.9 * law.coulomb_force, stiction_force=0.9 * law.stiction_force
            ),
        ),
        "worn": KANG.replace(friction=law._replace(sigma_0=0.7 * law.sigma_0, sigma_1=1.3 * law.sigma_1)),
        "steep": KANG.replace(incline=np.deg2rad(3.0)),
    }
    assert list(found.table.index) == list(models)
    for name, model in models.items():
        speed = exact(model, found.waveform) * found.frequency
        assert found.table.value[name] == pytest.approx(speed, rel=1e-4)


@pytest.mark.parametrize("late", [False, True])
def test_what_was_found_before_an_interruption_stays(late):
    """Ctrl-C, at the third word of a search, or of a front at the third after its first search."""
    heard = []

    def progress(doing, share):
        heard.append(share)
        if len(heard) == 4:
            raise KeyboardInterrupt

    if late:
        front = design.waveform_front(
            KANG, goals=("speed", design.Current("1.4 uF")), max_voltage=100.0, points=8, progress=progress
        )
        assert front.interrupted
        assert len(front.waveforms) >= 2
        assert np.all(np.diff(front.table.speed.values) > 0.0)
        return
    found = ss.optimise_waveform(KANG, goal="speed", max_voltage=100.0, knots=6, progress=progress)
    assert found.interrupted
    assert "stopped before the end" in found.report()
    assert found.value == pytest.approx(exact(KANG, found.waveform) * found.frequency, rel=1e-4)
    assert found.value >= found.sawtooth_value
    assert max(heard[:-1]) < 0.3, "early"


def test_a_step_of_a_given_size():
    found = ss.optimise_waveform(
        KANG, goal=design.StepSize("2 um"), max_voltage=100.0, knots=4, budget=400, minimum_speed="0.2 mm/s"
    )
    assert found.value < 1e-8
    assert exact(KANG, found.waveform) == pytest.approx(2e-6, abs=1.01 * found.value + 1e-11)
    assert found.speeds[0] > 0.199e-3


def test_on_the_virtual_rig_with_its_electronics():
    """Converter, amplifier and the current into the piezo: within 2 %; measured: 0.002 %."""
    bench = load_bench("kang2007-bench")
    found = ss.optimise_waveform(
        KANG,
        goal="speed",
        max_voltage=100.0,
        output=bench.output(1024),
        budget=300,
    )
    assert found.value > 1.3 * found.sawtooth_value
    played, periods = found.played, 120
    assert played is not None
    assert played.period is not None
    rig, count = VirtualRig(KANG, bench), played.times.size
    rig.load(np.tile(played.values, periods))
    rig.arm(("ideal",), count * periods)
    rig.start()
    blocks = []
    while (block := rig.fetch()).size:
        blocks.append(block)
    position = np.concatenate(blocks, axis=1)[0]
    rig.stop(1e6)
    speed = (position[-1] - position[-1 - 40 * count]) / (40 * played.period)
    assert speed == pytest.approx(found.value, rel=2e-3)


def test_the_most_even_motion():
    """Ripple is that of the trajectory, and the speed what was asked for."""
    model = KANG.replace(damping_ratio=0.1)
    limits = {"max_voltage": 100.0, "frequency": (50.0, 400.0)}
    found = ss.optimise_waveform(model, goal="ripple", minimum_speed="1 mm/s", budget=500, **limits)
    assert found.value < 0.7 * found.sawtooth_value
    assert found.speeds[0] >= 0.999e-3
    period = found.waveform.period
    times = np.append(0.0, np.linspace(200.0, 201.0, 2001) * period)
    x = ss.simulate(model, found.waveform, times=times, tolerance=1e-10).end_effector_position.values[1:]
    uniform = np.linspace(x[0], x[-1], x.size)
    assert np.ptp(x - uniform) == pytest.approx(found.value, rel=5e-3)
    assert (x[-1] - x[0]) / period == pytest.approx(found.speeds[0], rel=1e-4)
    front = design.waveform_front(model, goals=("speed", "ripple"), points=8, generations=4, **limits)
    assert np.all(np.diff(front.table.speed.values) > 0.0)
    assert np.all(np.diff(front.table.ripple.values) > 0.0)


def test_the_least_backward_motion() -> None:
    """The backward rate is that of the trajectory, and less than that of the best sawtooth."""
    limits = {"max_voltage": 100.0, "frequency": (20.0, 60.0)}
    found = ss.optimise_waveform(KANG, goal="backward_rate", minimum_speed="0.2 mm/s", budget=300, **limits)
    assert found.value < 0.98 * found.sawtooth_value
    assert found.speeds[0] >= 0.1998e-3
    period = found.waveform.period
    times = np.append(0.0, np.linspace(200.0, 201.0, 2001) * period)
    x = ss.simulate(KANG, found.waveform, times=times, tolerance=1e-10).end_effector_position.values[1:]
    assert design.backward_rate(x) == pytest.approx(found.value, abs=2e-3)
    assert "backward rate" in found.report()


def test_a_front_of_speed_and_current():
    found = design.waveform_front(
        KANG,
        goals=("speed", design.Current("1.4 uF")),
        max_voltage=100.0,
        frequency=(200.0, 800.0),
        points=10,
        generations=5,
    )
    speed, current = found.table.speed.values, found.table.peak_current.values
    assert len(found.waveforms) == speed.size >= 5
    assert np.all(np.diff(speed) > 0.0)
    assert np.all(np.diff(current) > 0.0)
    last = found.waveforms[-1]
    assert speed[-1] == pytest.approx(exact(KANG, last) / last.period, rel=1e-4)
    times, volts = np.array([*last.times, last.period]), np.array([*last.values, last.values[0]])
    assert current[-1] == pytest.approx(1.4e-6 * np.abs(np.diff(volts) / np.diff(times)).max())
    with pytest.raises(ss.QuantityError, match="must be two"):
        design.waveform_front(KANG, goals=("speed",))  # type: ignore[arg-type]


def test_what_stays_of_a_front():
    """Against the definition, one by one."""
    merits = np.random.default_rng(0).random((40, 2))
    beaten = [any(np.all(o >= m) and np.any(o > m) for o in merits) for m in merits]
    assert np.array_equal(unbeaten(merits), ~np.array(beaten))
    stay = selected(merits, 20)
    assert len(set(stay.tolist())) == 20
    assert set(np.flatnonzero(unbeaten(merits))) <= set(stay.tolist())


def test_heat_is_that_of_the_account():
    stack = ss.physics.electronics.Stack(1.4e-6, 0.02, 8.0, 150.0, 20.0, 5.0)
    shape = design.polygons.Polygons(
        np.array([[0.0, 0.3, 0.6, 0.8]]), np.array([[0.0, 90.0, 40.0, 70.0]]), np.array([2e-3])
    )
    heat = design.Heat(stack).of(shape, PeriodicMotions(*np.zeros((3, 1, 1))))
    account = ss.physics.electronics.electrical(shape.one(0), stack, 400 * 2e-3)
    assert float(heat[0, 0]) == pytest.approx(float(account.mean_loss), rel=5e-3)
