"""What the laws do to energy."""

from __future__ import annotations

import math

import numpy as np

from stickslip.friction import LuGre, rate

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
