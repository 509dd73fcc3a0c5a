r"""Limits in which one friction law becomes another [kang2007, sec. 3.2], tested on an actuator.

A hard bristle becomes a static law as slowly as :math:`1/\sqrt{\sigma_0}`. The elastoplastic law with a
breakaway deflection z_ba of 0 is not LuGre: the share alpha of plastic motion still grows from 0 to 1 over
presliding, so only sliding is the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    ResetIntegrator,
    StictionCoulombViscous,
    Stribeck,
)
from ...physics.actuator import Actuator
from ...quantities.units import optional_si
from ...simulation import simulate
from ...waveform.signal import Waveform


@dataclass(frozen=True)
class Limit:
    """A friction law that becomes another one in a limit.

    Fields: the names of the law (`law`) and of the other one (`becomes`), the `condition` of the limit in
    words, and the largest `difference` [m] between the end-effector's positions with these two laws.
    """

    law: str
    condition: str
    becomes: str
    difference: float


def compare_limits(
    actuator: Actuator, waveform: Waveform, stiction_force: float | str | None = None
) -> list[Limit]:
    """Return a test of each limit: two periods simulated with a law close to the limit, and with the law that
    it becomes.

    Args:
        actuator: its friction must be a `LuGre` contact, whose values all laws share.
        waveform: a periodic drive.
        stiction_force: stiction of the laws that have one, N; by default 1.3 times Coulomb friction.
    """
    stiction = optional_si(stiction_force, "N", "stiction_force")
    contact = actuator.friction
    sigma_0, sigma_1, f_c = contact.sigma_0, contact.sigma_1, contact.coulomb_force
    f_s = 1.3 * f_c if stiction is None else stiction
    z_c, hard, v_s, sigma_2 = f_c / sigma_0, 1e4 * sigma_0, 1e-3, 5.0
    pure = LuGre(sigma_0, 0.0, 0.0, f_c, f_c)
    pairs = [
        ("LuGre", "σ₁ = σ₂ = 0, F_S = F_C", pure, "Dahl, α = 1", Dahl(sigma_0, f_c)),
        (
            "LuGre",
            "σ₀ × 10⁴",
            LuGre(hard, sigma_1, sigma_2, f_c, f_s, v_s),
            "Stribeck",
            Stribeck(f_c, f_s, v_s, sigma_2),
        ),
        ("Dahl", "σ₀ × 10⁴", Dahl(hard, f_c), "Coulomb", Coulomb(f_c)),
        (
            "Elastoplastic",
            "z_ba = 0.999 F_C/σ₀, F_S = F_C, σ₁ = σ₂ = 0",
            Elastoplastic(sigma_0, 0.0, 0.0, f_c, f_c, 0.999 * z_c),
            "Reset integrator, a = 0",
            ResetIntegrator(sigma_0, z_c),
        ),
        (
            "Elastoplastic",
            "z_ba = 0 alone (no limit: it needs α = 1 too)",
            Elastoplastic(sigma_0, sigma_1, 0.0, f_c, f_c, 0.0),
            "LuGre",
            LuGre(sigma_0, sigma_1, 0.0, f_c, f_c),
        ),
        (
            "Maxwell slip",
            "three equal elements",
            MaxwellSlip((sigma_0 / 3.0,) * 3, (f_c / 3.0,) * 3),
            "Reset integrator, a = 0",
            ResetIntegrator(sigma_0, z_c),
        ),
        (
            "Stribeck",
            "v_s × 10⁻⁴",
            Stribeck(f_c, f_s, 1e-4 * v_s, sigma_2),
            "Stiction + Coulomb + viscous",
            StictionCoulombViscous(f_c, f_s, sigma_2),
        ),
        (
            "Stiction + Coulomb + viscous",
            "F_S = F_C",
            StictionCoulombViscous(f_c, f_c, sigma_2),
            "Coulomb + viscous",
            CoulombViscous(f_c, sigma_2),
        ),
        ("Coulomb + viscous", "σ₂ = 0", CoulombViscous(f_c, 0.0), "Coulomb", Coulomb(f_c)),
    ]

    def walk(law: Any) -> NDArray[np.float64]:
        time = np.linspace(0.0, 2.0 * waveform.period, 2001)  # type: ignore[attr-defined]
        model = actuator.replace(friction=law)
        return simulate(model, waveform, times=time, tolerance=1e-10)["end_effector_position"].values

    return [
        Limit(name, condition, becomes, float(np.abs(walk(law) - walk(other)).max()))
        for name, condition, law, becomes, other in pairs
    ]
