"""Plants that together use everything there is, each in some motion."""

from __future__ import annotations

from typing import NamedTuple

from plants import Lag
from stickslip.friction import (
    Coulomb,
    CoulombViscous,
    Dahl,
    Elastoplastic,
    LuGre,
    MaxwellSlip,
    NormalForce,
    Stribeck,
)
from stickslip.simulation.plant.system import Element, Mode, Plant

LUGRE = LuGre(1.4e6, 35.0, 0.7, 0.54, 0.7, 1e-3)
DAHL = Dahl(0.9e6, 0.4)
ELASTOPLASTIC = Elastoplastic(1.4e6, 35.0, 0.3, 0.54, 0.6, 1e-7)
MAXWELL = MaxwellSlip((1.3e6, 4e5), (0.3, 0.09), 4.0, 1.2)
COULOMB = CoulombViscous(0.5, 6.0)


STAGE = Mode(1.09e7, 3460.0, 1.15, 0.3)
SLIDER = Mode(4e5, 120.0, 0.02, -0.7)
FREE = Mode(0.0, 90.0, 0.3, 1.7)
U = (40.0, 3e4, -2e8, 5e11)  # drive and its derivatives by time
RISING, FALLING = (1.1, 700.0, -4e5, 2e8), (0.8, -700.0, 3e5, -1e8)
PER_G = 1e-4  # s
RATE = 3303.0  # rad/s


class Case(NamedTuple):
    plant: Plant
    motion: tuple[float, ...]  # position [um] and velocity [mm/s] of each mode
    inside: tuple[float, ...]  # states of the elements in their scale
    held: tuple[int, ...] = ()
    normal: tuple[float, ...] = RISING


def in_row(m: int, one: float, other: float) -> tuple[float | None, ...]:
    """Shares of mode m and the next one, of six."""
    return (None,) * m + (one, other) + (None,) * (4 - m)


CASES = {
    "stage and slider": Case(
        Plant((STAGE, FREE), (Element(LUGRE, (1.0, -1.0), (-10.0, 7.7), 1.3),), RATE),
        (1.0, 3.0, 0.2, 1.0),
        (2.0,),
    ),
    "three modes and slider": Case(
        Plant(
            (STAGE, Mode(3e7, 900.0, 0.4, -0.2), Mode(5e7, 1300.0, -0.2, 0.1), FREE),
            (Element(ELASTOPLASTIC, (1.0, 0.8, -0.5, -1.0), (-10.0, -6.0, 3.0, 7.7)),),
            RATE,
        ),
        (1.0, -3.0, 0.3, -0.4, 0.5, 0.7, 0.2, 1.0),
        (-2.4,),
    ),
    "two sliders": Case(
        Plant(
            (STAGE, FREE, SLIDER),
            (
                Element(LUGRE, (1.0, -1.0, None), (-10.0, 7.7, None)),
                Element(DAHL, (1.0, None, -1.0), (-9.0, None, 12.0), 0.7),
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0, -0.6, 5.0),
        (2.0, -1.5),
    ),
    "three contacts": Case(
        Plant(
            (SLIDER,),
            (
                Element(MAXWELL, (-1.0,), (12.0,), 1.2),
                Element(COULOMB, (-1.0,), (13.0,), 0.9),
                Element(DAHL, (-1.1,), (14.0,)),
            ),
            RATE,
        ),
        (0.6, 3.0),
        (-1.1, -2.5, 1.4),
    ),
    "held": Case(
        Plant(
            (STAGE, FREE),
            (Element(COULOMB, (1.0, -1.0), (-10.0, 7.7)), Element(DAHL, (1.0, -1.0), (-10.0, 7.7))),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0),
        (1.2,),
        held=(0,),
    ),
    "held to the drive": Case(
        Plant((SLIDER,), (Element(COULOMB, (-1.0,), (12.0,), 0.8, drive_rate=1e-7),), RATE),
        (0.6, 3.0),
        (),
        held=(0,),
    ),
    "slides from the drive": Case(
        Plant(
            (SLIDER,),
            (
                Element(LUGRE, (-1.0,), (12.0,), drive_rate=1e-7),
                Element(COULOMB, (-1.0,), (11.0,), drive_rate=1.2e-7),
            ),
            RATE,
        ),
        (0.6, 1.1),
        (1.3,),
    ),
    "held in a chain": Case(
        Plant(
            (STAGE, FREE, SLIDER),
            (
                Element(COULOMB, (1.0, -1.0, None), (-10.0, 7.7, None)),
                Element(LUGRE, (None, -1.0, 1.0), (None, 7.0, -5.0)),
                Element(Coulomb(0.3), (None, 1.0, -1.0), (None, -7.7, 12.0)),
                Element(
                    Stribeck(0.3, 0.5, 1e-3, 2.0, 1.0),
                    (0.5, None, 1.0),
                    (-6.0, None, -11.0),
                    drive_rate=1e-7,
                ),
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0, -0.6, 4.0),
        (1.2,),
        held=(0, 2, 3),
    ),
    "held but for one": Case(
        Plant(
            (STAGE, FREE, SLIDER),
            (
                Element(COULOMB, (1.0, -1.0, None), (-10.0, 7.7, None)),
                Element(CoulombViscous(0.3, 20.0), (None, 1.0, -1.0), (None, -7.7, 12.0)),
                Element(Coulomb(0.3), (0.5, None, 1.0), (-6.0, None, -11.0)),
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0, -0.6, 4.0),
        (),
        held=(0, 2),
    ),
    "held twice over": Case(
        Plant(
            (STAGE, FREE),
            (
                Element(COULOMB, (1.0, -1.0), (-10.0, 7.7)),
                Element(Coulomb(0.3), (0.3, -0.3), (-1.7, 1.309)),
                Element(LUGRE, (1.0, -1.0), (-10.0, 7.7)),
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0),
        (1.2,),
        held=(0, 1),
    ),
    "held in a row": Case(
        Plant(
            (STAGE, FREE, SLIDER, FREE, STAGE, SLIDER),
            tuple(
                Element(COULOMB, in_row(m, 1.0 + 0.1 * m, -1.0), in_row(m, -10.0 + m, 7.0 - 0.5 * m))
                for m in range(5)
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0, -0.6, 4.0, 0.3, 2.0, 0.7, -1.0, 0.5, 1.5),
        (),
        held=(0, 1, 2, 3, 4),
    ),
    "pushes what it does not feel": Case(
        Plant((STAGE, FREE), (Element(COULOMB, (1.0, None), (None, 7.7)),), RATE), (1.0, 3.0, 0.2, 1.0), ()
    ),
    "a rising load": Case(
        Plant(
            (STAGE, FREE, SLIDER),
            (
                Element(LUGRE, (1.0, -1.0, None), (-10.0, 7.7, None), 1.3, 1.0),
                Element(COULOMB, (1.0, None, -1.0), (-10.0, None, 11.0), 0.9, 1.0),
                Element(MAXWELL, (None, 1.0, -1.0), (None, -7.7, 12.0), 0.8, 1.0),
                Element(DAHL, (None, 1.0, -1.0), (None, -7.7, 12.0)),
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0, -0.6, -2.0),
        (2.0, 1.1, 2.5, -1.4),
    ),
    "elements without a kink": Case(
        Plant(
            (STAGE, FREE),
            (
                Element(Lag(5e3, 0.1, 0.2), (None, 20.0), (None, None), 1.1, position=(4e5, None)),
                Element(Lag(3e3, 0.2, 0.3), (None, None), (30.0, None), 0.9, None, 1e-5, 0.02, feed=(0.7,)),
                Element(LUGRE, (1.0, -1.0), (-10.0, 7.7), 1.2, feed=(2e-4, None)),
                Element(
                    Lag(4e3, 0.3, 0.1),
                    (200.0, None),
                    (None, -20.0),
                    position=(2e5, 1e5),
                    feed=(None, 0.5, 0.9),
                ),
            ),
            RATE,
        ),
        (1.0, 3.0, 0.2, 1.0),
        (0.7, -0.4, 1.5, 0.6),
    ),
    "no body": Case(
        Plant(
            (),
            (
                Element(Lag(5e3, 0.1, 0.2), (), (), drive=0.02),
                Element(Lag(2e3, 0.3, 0.1), (), (), feed=(0.8,)),
            ),
            RATE,
        ),
        (),
        (0.7, -0.4),
    ),
    "no element": Case(Plant((STAGE,), (), RATE), (1.0, 3.0), ()),
}
ALONG = NormalForce(
    slope=3e5,
    power=-2.0,
    ripple=0.1,
    wavelength=2e-6,
    phase=0.4,
    stiffness_exponent=0.4,
    asymmetry=0.1,
)
CASES["a load along the stroke"] = Case(
    Plant(
        (STAGE, FREE, SLIDER),
        (
            Element(LUGRE, (1.0, -1.0, None), (-10.0, 7.7, None), 1.3, 1.0, along=ALONG),
            Element(MAXWELL, (1.0, None, -1.0), (-10.0, None, 12.0), 0.8, along=ALONG._replace(power=1.0)),
        ),
        RATE,
    ),
    (1.0, 3.0, 0.2, 1.0, -0.6, 2.0),
    (2.0, 1.1, 2.5),
)
CASES["back along the stroke"] = CASES["a load along the stroke"]._replace(
    motion=(1.0, 3.0, 0.2, -2.5, -0.6, -2.0), normal=FALLING
)
CASES["slides along the stroke"] = Case(
    Plant(
        (STAGE, FREE, SLIDER),
        (
            Element(
                COULOMB,
                (1.0, -1.0, None),
                (-10.0, 7.7, None),
                0.9,
                along=ALONG._replace(stiffness_exponent=1.0, asymmetry=0.0),
            ),
            Element(LUGRE, (1.0, None, -1.0), (-10.0, None, 12.0), 0.8),
        ),
        RATE,
    ),
    (1.0, 3.0, 0.2, 1.0, -0.6, 2.0),
    (1.1,),
)
CASES["held along the stroke"] = CASES["slides along the stroke"]._replace(held=(0,))
CASES["a falling load"] = CASES["a rising load"]._replace(normal=FALLING)
