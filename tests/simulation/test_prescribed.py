"""Laws under a prescribed motion, normal force as an input, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from stickslip.friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    NormalForce,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
    element,
    rate,
)
from stickslip.physics.actuator import Actuator
from stickslip.quantities.units import QuantityError
from stickslip.simulation import friction_response, simulate, steady_step
from stickslip.waveform.periodic import Sawtooth, Sine
from stickslip.waveform.shapes import Constant

LAW = LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401)
MODEL = Actuator(0.1057e-6, 3303.1, 0.524, 0.0998, 0.1, LAW, stage_reaction=False)
DRIVE = Sawtooth(amplitude=65.0, frequency=5.0)


def test_dahl_under_constant_velocity_is_its_closed_form() -> None:
    law = Dahl(1e6, 0.5)
    time = np.linspace(0.0, 1.0, 101)
    found = friction_response(law, time, 1e-5 * time, tolerance=1e-13)
    exact = 0.5 * (1.0 - np.exp(-1e6 * 1e-5 * time / 0.5))
    np.testing.assert_allclose(found["friction_force"], exact, atol=1e-6)


@pytest.mark.parametrize("exponent", [0.1, 0.9])
@pytest.mark.parametrize("way", [5e-6, -1e-2])
def test_a_brittle_contact_reaches_its_bound_and_stays_there(exponent: float, way: float) -> None:
    law, time = Dahl(1e6, 0.5, exponent), np.linspace(0.0, 1.0, 101)
    found = friction_response(law, time, way * time, tolerance=1e-13)["friction_force"].values
    path = abs(way) * time * law.sigma_0 / law.coulomb_force
    left = np.maximum(1.0 - (1.0 - exponent) * path, 0.0) ** (1.0 / (1.0 - exponent))
    np.testing.assert_allclose(found[1:], np.copysign(0.5 * (1.0 - left), way)[1:], atol=1e-6)


def test_force_follows_the_normal_force_sample_by_sample() -> None:
    time = np.linspace(0.0, 2.0, 401)
    position = 1e-6 * np.sin(2 * np.pi * time)
    normal = 5.0 + np.sin(7.0 * time)
    plain = friction_response(LAW, time, position, tolerance=1e-12)
    loaded = friction_response(
        LAW,
        time,
        position,
        normal_force=normal,
        reference_normal_force=5.0,
        proportional=True,
        tolerance=1e-12,
    )
    expected = plain["friction_force"].values * normal / 5.0
    np.testing.assert_allclose(loaded["friction_force"], expected, atol=1e-6)


def exact_under_load(law, normal, time, velocity):
    """SciPy's solution of z' = rate(v, z) - max(N', 0)/N z, times N; normal force N = a + b t."""
    a, b = normal

    def slope(t, z):
        grown = max(b, 0.0) / (a + b * t)
        return [rate(law, velocity, z[0])[1] - grown * z[0]]

    z = solve_ivp(slope, (0.0, time[-1]), [1e-7], t_eval=time, rtol=1e-11, atol=1e-18, max_step=1e-2).y[0]
    return np.array([(a + b * t) * rate(law, velocity, d)[0] for t, d in zip(time, z, strict=True)])


@pytest.mark.parametrize("normal", [(1.0, 3.0), (1.0, -0.9)])
@pytest.mark.parametrize("velocity", [0.0, 2e-7])
@pytest.mark.parametrize(
    "law", [LuGre(1.4e6, 30.0, 0.5, 0.5, 0.6), Dahl(1e6, 0.5), MaxwellSlip((1e6,), (0.5,))]
)
def test_what_is_newly_loaded_carries_nothing_and_what_is_unloaded_loses_its_share(
    law, normal, velocity
) -> None:
    time = np.linspace(0.0, 1.0, 11)
    found = friction_response(
        law,
        time,
        velocity * time,
        normal_force=normal[0] + normal[1] * time,
        initial_force=1e-7 * (law.stiffness[0] if isinstance(law, MaxwellSlip) else law.sigma_0),
        tolerance=1e-15,
    )
    one = element(law, 0)
    expected = exact_under_load(one, normal, time, velocity)
    np.testing.assert_allclose(found["friction_force"][1:], expected[1:], rtol=1e-5)
    if velocity == 0.0:  # at rest: the force stays under more load, and falls with less
        share = np.minimum(1.0, 1.0 + normal[1] * time)
        np.testing.assert_allclose(found["friction_force"][1:], expected[0] * share[1:], rtol=1e-7)


def test_a_normal_force_along_the_position() -> None:
    """Out over a wedge and back, against SciPy over the position: growing renews, falling sheds."""
    law, along = Dahl(1e6, 0.5), NormalForce(slope=5e4, origin=2e-6)
    way = np.concatenate([np.linspace(0.0, 8e-6, 2001), np.linspace(8e-6, 1e-6, 2001)[1:]])
    time = np.linspace(0.0, 1.0, way.size)
    found = friction_response(law, time, way, normal_force=along, tolerance=1e-13)

    def slope(x: float, zeta: NDArray[np.float64], back: float) -> NDArray[np.float64]:
        grown = along.slope / (1.0 + along.slope * (along.origin + x))
        renewed = grown * zeta if back > 0.0 else 0.0  # forward the load grows, backward it falls
        return 1.0 - back * law.sigma_0 * zeta / law.coulomb_force - renewed

    exact, zeta = [], np.zeros(1)
    for part, back in ((way[:2001], 1.0), (way[2000:], -1.0)):
        solved = solve_ivp(slope, part[[0, -1]], zeta, "LSODA", part, args=(back,), rtol=1e-11, atol=1e-18)
        zeta = solved.y[:, -1]
        exact.append(law.sigma_0 * solved.y[0] * along.factor(part))
    np.testing.assert_allclose(found["friction_force"], np.append(exact[0], exact[1][1:]), atol=2e-6)
    bent = along._replace(stiffness_exponent=1 / 3)
    with pytest.raises(QuantityError, match=r"stiffness_exponent = 0\.333"):
        friction_response(law, time, way, normal_force=bent)


@pytest.mark.parametrize(
    "law",
    [
        LuGre(1.4e6, 34.9, 0.0, 0.54, 0.54),
        Dahl(1.4e6, 0.54),
        Elastoplastic(1.4e6, 34.9, 0.0, 0.54, 0.54, 2e-7),
        MaxwellSlip((1e6, 4e5), (0.3, 0.24)),
        ResetIntegrator(1.4e6, 4e-7),
        Coulomb(0.54),
    ],
    ids=lambda law: type(law).__name__,
)
def test_contact_that_is_made_anew_carries_no_tangential_force(law) -> None:
    """Slide 200 µm without load, stop, then load."""
    time = np.linspace(0.0, 2.0, 2001)
    position = 200e-6 * np.minimum(time, 1.0)
    normal = np.clip(10.0 * (time - 1.2), 0.0, 1.0)
    found = friction_response(law, time, position, normal_force=normal)["friction_force"].values
    assert normal[-1] == 1.0
    assert np.all(found[time > 1.2] == 0.0)


def test_a_static_law_keeps_its_force_while_the_motion_pauses() -> None:
    time = np.array([0.0, 1.0, 2.0, 3.0])
    found = friction_response(Coulomb(0.3), time, np.array([0.0, 1e-3, 1e-3, 0.0]))
    np.testing.assert_allclose(found["friction_force"][1:], [0.3, 0.3, -0.3])


@pytest.mark.parametrize(
    ("law", "stopped"),
    [
        (Coulomb(0.3), 0.3),
        (CoulombViscous(0.3, 100.0), 0.3),
        (StictionCoulombViscous(0.3, 0.4, 10.0), 0.31),
        (StictionCoulombViscous(0.3, 0.4, 1000.0), 0.4),
        (Stribeck(0.3, 0.4, 1e-5), 0.3),
        (Coulomb(0.0), 0.0),
    ],
    ids=repr,
)
@pytest.mark.parametrize("least", [0.0, 0.5])
def test_a_static_law_at_rest_carries_no_more_under_more_load(law, stopped: float, least: float) -> None:
    """Slide under load 1, stop, double the load; halve it; shed all but the `least`, and load anew."""
    time = np.arange(9.0)
    position = 1e-3 * np.array([0.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 0.0])
    normal = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 1.0, least, 1.0, 1.0])
    found = friction_response(law, time, position, normal_force=normal)["friction_force"].values
    sliding = rate(law, 1e-3, 1.0)[0]
    held = np.array([1.0, 1.0, 1.0, 0.5, 0.5 * least, 0.5 * least])
    np.testing.assert_allclose(found, [-sliding, -sliding, *(-stopped * held), sliding], rtol=1e-12)
    scaled = friction_response(law, time, position, normal_force=normal, proportional=True)
    expected = [-sliding, -sliding, *(-stopped * normal[2:8]), sliding]
    np.testing.assert_allclose(scaled["friction_force"], expected, rtol=1e-12)


@pytest.mark.parametrize("excess", [0.0, 0.3])
def test_a_reset_integrator_at_rest_jumps_once_by_its_excess_under_more_load(excess: float) -> None:
    """The limit that its docstring says: |z| < z_0 is not broken away."""
    time = np.arange(5.0)
    found = friction_response(
        ResetIntegrator(1e6, 5e-7, excess),
        time,
        np.array([0.0, 1e-3, 1e-3, 1e-3, 1e-3]),
        normal_force=np.array([1.0, 1.0, 1.0, 1.001, 2.0]),
        tolerance=1e-16,
    )["friction_force"].values
    held = 0.5 * (1.0 + excess)
    np.testing.assert_allclose(found[1:], [0.5, 0.5, held, held], rtol=1e-7)


def test_a_constant_load_scales_the_law() -> None:
    """Doubling the normal force is doubling every force of the law at the same deflection."""
    doubled = MODEL.replace(friction=LuGre(2 * 1.399e6, 2 * 34.9, 0.0, 2 * 0.5401, 2 * 0.5401))
    assert steady_step(MODEL, DRIVE, load=2.0) == pytest.approx(steady_step(doubled, DRIVE), abs=2e-10)
    one = simulate(MODEL, DRIVE, 0.4, load=Constant(2.0), tolerance=1e-11)
    other = simulate(doubled, DRIVE, 0.4, tolerance=1e-11)
    for name in ("end_effector_position", "friction_force"):
        np.testing.assert_allclose(one[name], other[name], atol=1e-8 if "position" in name else 1e-4)


def test_a_load_that_breathes_in_step_with_the_drive_changes_the_step() -> None:
    """Light in the ramp is no matter; light in the flyback lets the slider slip more."""
    light = Sine(amplitude=0.3, frequency=5.0, phase=np.pi / 2, offset=1.0)
    heavy = Sine(amplitude=0.3, frequency=5.0, phase=-np.pi / 2, offset=1.0)
    assert (
        steady_step(MODEL, DRIVE, load=heavy)
        > steady_step(MODEL, DRIVE)
        > steady_step(MODEL, DRIVE, load=light)
    )


@pytest.mark.parametrize("load", [-1.0, float("nan"), Sine(amplitude=2.0, frequency=5.0, offset=1.0)])
def test_a_lost_contact_is_refused(load: object) -> None:
    with pytest.raises(QuantityError, match="load"):
        simulate(MODEL, DRIVE, 0.4, load=load)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("time", "position", "normal", "words"),
    [
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], None, "ascending"),
        ([0.0, 1.0], [0.0, 1.0, 2.0], None, "one length"),
        ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [1.0, 2.0], "normal_force"),
    ],
)
def test_wrong_motions_are_refused(time, position, normal, words: str) -> None:
    with pytest.raises(QuantityError, match=words):
        friction_response(LAW, time, position, normal_force=normal)
    with pytest.raises(QuantityError, match="no friction law"):
        friction_response("LuGre", [0.0, 1.0], [0.0, 1.0])


@pytest.mark.parametrize(("samples", "tolerance"), [(40, 1e-11), (400, 1e-9)])
def test_deflections_are_within_the_tolerance_and_their_estimate(samples: int, tolerance: float) -> None:
    """Against LSODA; where each interval is one step, too, and smaller local errors alone change nothing."""
    random = np.random.default_rng(4)
    for _ in range(2):
        coulomb = random.uniform(0.2, 0.8)
        law = LuGre(
            10 ** random.uniform(5, 7), 10.0, 0.0, coulomb, 1.3 * coulomb, 10 ** random.uniform(-4, -2)
        )
        time = np.linspace(0.0, 1.0, samples)
        position = 10 ** random.uniform(-6.5, -4.5) * np.sin(2 * np.pi * random.uniform(1.0, 8.0) * time)
        found = friction_response(law, time, position, tolerance=tolerance)
        z = [0.0]
        for velocity, step in zip(np.diff(position) / np.diff(time), np.diff(time), strict=True):
            exact = solve_ivp(
                lambda _, z, v=velocity, law=law: [rate(law, v, z[0])[1]],
                (0.0, step),
                z[-1:],
                method="LSODA",
                rtol=1e-11,
                atol=1e-17,
            )
            z.append(float(exact.y[0, -1]))
        off = np.max(np.abs(found["bristle_deflection_1"].values - z))
        assert off <= found.attrs["error_estimate"] + 0.2 * tolerance
        assert found.attrs["error_estimate"] <= tolerance
