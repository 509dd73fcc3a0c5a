"""What the laws do to energy, and whether a contact creeps under a load that it should hold."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip.friction import (
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    element,
    elements,
    rate,
)

from .motion import response

SIGMA_0, SIGMA_1, F_C, F_S = 1.399e6, 34.9, 0.54, 0.7
Z_C = F_C / SIGMA_0


def work_of_cycle(law):
    """Work [J] put into the contact per closed cycle: load it at 10 um/s, burst at 1 m/s over one presliding
    distance, and the same backwards; once periodic."""
    slow, fast, n = 1e-5, 1.0, 500
    half_v = np.repeat([slow, fast], n)
    half_dt = np.repeat([4 * Z_C / slow / n, Z_C / fast / n], n)
    v, dt = np.tile(np.concatenate([half_v, -half_v]), 3), np.tile(half_dt, 6)
    first, last, _ = response(law, v, dt, np.zeros(1))
    return (0.5 * (first + last) * v * dt)[-4 * n :].sum()


def test_lugre_with_constant_damping_gives_energy_away_and_with_fading_damping_does_not():
    """Not passive where sigma_2 < sigma_1 (F_S - F_C)/F_C: closed cycles then feed the motion."""
    needed = SIGMA_1 * (F_S - F_C) / F_C
    assert work_of_cycle(LuGre(SIGMA_0, SIGMA_1, 0.0, F_C, F_S)) < -1e-6
    assert work_of_cycle(LuGre(SIGMA_0, SIGMA_1, 1.01 * needed, F_C, F_S)) > 0
    assert work_of_cycle(LuGre(SIGMA_0, SIGMA_1, 0.0, F_C, F_C)) > 0  # the thesis's form is passive
    assert work_of_cycle(LuGre(SIGMA_0, SIGMA_1, 0.0, F_C, F_S, damping_velocity=9.3 * F_C / SIGMA_1)) > 0


def test_lugre_with_fading_damping_dissipates_at_every_instant():
    """F v minus the rate of the stored energy is nowhere negative where sigma_1(v) |v| <= 4 g(v)."""
    law = LuGre(SIGMA_0, SIGMA_1, 0.0, F_C, F_S, damping_velocity=9.3 * F_C / SIGMA_1)
    constant = law._replace(damping_velocity=math.inf)
    rng = np.random.default_rng(1996)
    least = {law: math.inf, constant: math.inf}
    for v, z in zip(10 ** rng.uniform(-6, 1, 4000), rng.uniform(-1, 1, 4000) * F_S / SIGMA_0, strict=True):
        for one in least:
            force, dz = rate(one, v, z)
            least[one] = min(least[one], (force * v - SIGMA_0 * z * dz) / (F_C * v))
    assert least[law] > 0
    assert least[constant] < -1


def creep(law, cycles=4, frequency=20.0, mass=0.1, least=0.2 * F_C, most=0.8 * F_C):
    """Displacement [m] gained in the last cycle by a mass that an oscillating load below breakaway pushes."""
    n = elements(law)

    def motion(t, y):
        load = least + (most - least) * 0.5 * (1 - math.cos(2 * math.pi * frequency * t))
        load *= min(1.0, 2 * frequency * t)  # begins at rest
        v, slopes, force = y[1], np.empty(n), 0.0
        for e in range(n):
            one_force, slopes[e] = rate(element(law, e), v, y[2 + e])
            force += one_force
        return [v, (load - force) / mass, *slopes]

    ends = np.array([cycles - 1, cycles]) / frequency
    atol = [1e-12, 1e-9] + [1e-12] * n
    start = np.zeros(2 + n)
    solution = solve_ivp(motion, (0, ends[1]), start, method="LSODA", t_eval=ends, rtol=1e-9, atol=atol)
    assert solution.success
    return solution.y[0, 1] - solution.y[0, 0]


# Loading and unloading of Dahl's law along different curves, integrated over one slow cycle of the load.
CREEP_OF_DAHL = Z_C * (math.log(0.8 / 0.2) - math.log(1.8 / 1.2))


@pytest.mark.parametrize(
    "law", [LuGre(SIGMA_0, 300.0, 0.0, F_C, F_C), Dahl(SIGMA_0, F_C)], ids=["LuGre", "Dahl"]
)
def test_lugre_and_dahl_creep_under_an_oscillating_load_below_breakaway(law):
    assert creep(law) == pytest.approx(CREEP_OF_DAHL, rel=0.05)


@pytest.mark.parametrize(
    "law",
    [
        Elastoplastic(SIGMA_0, 300.0, 0.0, F_C, F_C, 0.95 * Z_C),
        ResetIntegrator(SIGMA_0, Z_C, sigma_2=300.0),
        MaxwellSlip((0.8 * SIGMA_0, 0.2 * SIGMA_0), (0.6 * F_C, 0.4 * F_C), sigma_2=300.0),
    ],
    ids=["Elastoplastic", "ResetIntegrator", "MaxwellSlip"],
)
def test_elastoplastic_reset_integrator_and_maxwell_slip_do_not_creep(law):
    assert abs(creep(law)) < 1e-3 * CREEP_OF_DAHL
