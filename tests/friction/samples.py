"""One or more examples of every law, with every branch of it in use; numbers near the thesis's contact."""

from __future__ import annotations

from stickslip.friction import (
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

STATIC = (
    Coulomb(0.54),
    CoulombViscous(0.54, 3.0),
    StictionCoulombViscous(0.54, 0.7, 3.0),
    Stribeck(0.54, 0.7, 1e-3, 3.0),
    Stribeck(0.54, 0.7, 1e-3, 3.0, exponent=0.7),
)
BRISTLE = (
    Dahl(1.399e6, 0.54),
    Dahl(1.399e6, 0.54, exponent=0.5),
    Dahl(1.399e6, 0.54, exponent=1.2),
    ResetIntegrator(1.399e6, 3.9e-7),
    ResetIntegrator(1.399e6, 3.9e-7, stiction_excess=0.3, sigma_2=20.0),
    LuGre(1.399e6, 34.9, 0.0, 0.5401, 0.5401),
    LuGre(1.399e6, 34.9, 5.0, 0.54, 0.7, 1e-3, damping_velocity=5e-3),
    Elastoplastic(1.399e6, 34.9, 5.0, 0.54, 0.7, 2e-7, 1e-3),
    Elastoplastic(1.399e6, 34.9, 5.0, 0.54, 0.54, 0.0),
    MaxwellSlip((0.8e6, 0.4e6, 0.2e6), (0.2, 0.2, 0.14)),
    MaxwellSlip((0.8e6, 0.4e6, 0.3e6), (0.3, 0.14, 0.1), 5.0, stiction_ratio=1.3, attraction_rate=5e3),
)
ALL = STATIC + BRISTLE


def name(law: object) -> str:
    """The label of an example in the list of tests."""
    return f"{type(law).__name__}-{ALL.index(law)}"
