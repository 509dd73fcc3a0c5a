"""Make the gallery: the figures of the thesis and the comparison of friction laws, in one folder.

    python examples/gallery.py [FOLDER]

writes FOLDER/gallery.md and FOLDER/figures/*.svg; FOLDER is out/gallery if left out. The gallery of the
documentation is made with FOLDER = docs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import stickslip as ss
from stickslip.comparison import (
    characterise_laws,
    compare_limits,
    example_laws,
    laws_as_markdown,
    limits_as_markdown,
)
from stickslip.figures import thesis
from stickslip.figures.style import svg

LOOPS = ("Coulomb", "Dahl", "Reset integrator", "LuGre", "Elastoplastic", "Maxwell slip")
PERIOD, ZOOM = 0.2, 0.012  # s, of the drive and of the flyback that is shown

TEXT = """\
# Gallery

The figures of the thesis [kang2007] that need no recording, and its comparison of friction laws (sec. 3.2),
made by `python examples/gallery.py`. What the thesis does not print is our choice, and said so at each.

## Static friction (fig. 2.1)

![Friction force over velocity of four static laws](figures/static-laws.svg)

The classical laws. At rest the force is not a function of the velocity: the contact carries whatever is
needed, up to breakaway (red). In c) it falls from there as soon as it moves. *Assumed: F_C = 0.54 N, that
of the thesis's actuator; F_S = 0.7 N, σ₂ = 20 N s/m and v_s = 2 mm/s, for the thesis's axes bear no
numbers.*

## Elastoplastic law (fig. 2.4)

![Plastic share over deflection](figures/plastic-share.svg)

The part α(z, v) of the motion that slides (eq. 2.20-2.21): none up to z_ba, all from z_ss on, and none
whenever the bristle is bent against the motion. The printed formula holds for z > 0; for z < 0 it is
mirrored. *Assumed: z_ss = F_C/σ₀ of the thesis's actuator, z_ba = 0.5 z_ss.*

## LuGre under a parabolic displacement (fig. 3.1-3.4)

![Friction force over displacement for four damping settings](figures/parabola.svg)

σ₀ = 600 N/µm, σ₁ = 100 N s/µm, σ₂ = 25 N s/µm, F_C = 10 N (grey), as printed; 3.2 is without σ₁, 3.1
without σ₂, 3.3 without both. *Assumed: the parabola, x = 15 µm/s² t². The thesis prints no scale, and no
time axis; with this one all that it says comes true: the peak above F_C that falls back to it (3.1), the
force that rises with the velocity (3.2), Dahl's curve without peak (3.3), and the higher peak before a
rising force (3.4). Only σ₁² and σ₂² times the acceleration count: σ in N s/m gives the same curves at 10¹²
times the acceleration.*

## Drive signals (fig. 3.7)

![Sawtooth, reverse sawtooth and a sequence of both](figures/drive.svg)

The sawtooth, the reverse sawtooth that walks back, and both in sequence. *65 V and 5 Hz are those of sec.
5.3.*

## A walk of the actuator

![Drive, positions, sliding and friction force, with one flyback enlarged](figures/walk.svg)

`simulate` with the parameter set `kang2007`, {step_forward} per period once periodic. In the rise the
end-effector rides on the stage; at the flyback the friction force reaches ±F_C (grey), the contact slides,
and the end-effector keeps part of the stroke. *Assumed: the mass of the end-effector, 0.1 kg; and the
friction acts back on the stage (eq. 3.20).*

![Walk forward, rest, walk back](figures/there-and-back.svg)

Eight periods forward and, with the reverse sawtooth, eight back: {step_forward} and {step_back} per period.

## Comparison of the laws (sec. 3.2)

Every cell is measured on the law by a small simulated experiment (`stickslip.comparison`): on a tribometer,
on a mass that a spring pulls or shakes, and on the actuator under 65 V and 5 Hz. All laws have F_C = 0.5401
N and, where they have a bristle, σ₀ = 1.399 N/µm and σ₁ = 34.9 N s/m of the thesis. *Assumed: F_S = 1.3
F_C, v_s = 1 mm/s, σ₂ = 5 N s/m, z_ba = 0.7 F_C/σ₀, and three Maxwell elements, for laws that have such a
parameter.*

{laws}

* *presliding*: stiffness at the start; elastic as far as a slow push and its return cost less than 0.1 % of
  the work; plastic until 99 % of the sliding force.
* *stiction*: force at breakaway under a slowly pulled spring over that of sliding. *Stribeck effect*:
  steady force at 10 µm/s over that at 10 mm/s, less the viscous part.
* *drift*: of a mass under a load that swings between 10 and 40 % of the sliding force.
* *force*: whether it jumps somewhere in smooth strokes.
* *net step* per period once periodic (`steady_step`); *solver steps* of eight periods at a tolerance of 1
  nm.

![Friction force over displacement under growing and shrinking strokes](figures/loops.svg)

Six of them under slow strokes of 0.1 µm to 1.5 µm (2 µm/s, from a relaxed contact).

### Limits

Two periods of the walk with a law near a limit and with the law that it should become there; the tolerance
is 0.1 nm. Hard bristles become static laws as slowly as 1/√σ₀. Elastoplastic with z_ba = 0 is not yet
LuGre: α still grows from 0 to 1 over presliding, and only where it is 1 are the equations the same.

{limits}
"""


def main(folder: Path) -> None:
    actuator = ss.load_actuator("kang2007")
    drive = ss.Sawtooth(65.0, 1 / PERIOD)
    back = ss.ReverseSawtooth(65.0, 1 / PERIOD)
    laws = example_laws(actuator.friction)

    shown = {
        "a)  Coulomb": ss.Coulomb(0.54),
        "b)  Coulomb, viscous": ss.CoulombViscous(0.54, 20.0),
        "c)  stiction, Coulomb, viscous": ss.StictionCoulombViscous(0.54, 0.7, 20.0),
        "d)  Stribeck": ss.Stribeck(0.54, 0.7, 2e-3, 20.0),
    }
    elastoplastic = laws["Elastoplastic"]._replace(breakaway_deflection=0.5 * 0.5401 / 1.399e6)
    flyback = np.linspace(0.0, ZOOM, 300)
    times = np.concatenate([np.arange(300) * 2e-3, PERIOD + flyback, 2 * PERIOD + flyback])
    steps = ss.simulate(actuator, drive, times=np.unique(times.round(9)))
    both = ss.Sequence(drive._replace(periods=8), ss.Rest(0.2), back._replace(periods=8))
    signals = {
        "sawtooth": drive,
        "reverse sawtooth": back,
        "two periods forward, rest, two back": ss.Sequence(
            drive._replace(periods=2), ss.Rest(0.2), back._replace(periods=2)
        ),
    }
    figures = {
        "static-laws": thesis.static_laws(shown, speed=8e-3),
        "plastic-share": thesis.plastic_share_over_deflection(elastoplastic),
        "parabola": thesis.under_the_parabola(thesis.demonstration(801)),
        "drive": thesis.drive_signals(signals, 1.0),
        "walk": thesis.walk(steps, (2 * PERIOD, 2 * PERIOD + ZOOM), friction=0.5401),
        "there-and-back": thesis.there_and_back(ss.simulate(actuator, both, 3.6, sample_rate=400.0)),
        "loops": thesis.friction_loops({name: strokes(laws[name]) for name in LOOPS}),
    }
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    for name, figure in figures.items():
        (folder / "figures" / f"{name}.svg").write_text(svg(figure) + "\n", encoding="utf-8")
    text = TEXT.format(
        laws=laws_as_markdown(characterise_laws(laws, actuator, drive)),
        limits=limits_as_markdown(compare_limits(actuator, drive)),
        step_forward=f"{1e6 * ss.steady_step(actuator, drive):+.3f} µm",
        step_back=f"{1e6 * ss.steady_step(actuator, back):+.3f} µm",
    )
    (folder / "gallery.md").write_text(text, encoding="utf-8")
    print(f"{len(figures)} figures and two tables: {folder / 'gallery.md'}")


def strokes(law: object) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and force [m, N] under strokes that grow and shrink again, at 2 µm/s."""
    turns = np.array([0.0, 0.1, -0.1, 0.4, -0.4, 1.5, -1.5, 0.4, -0.4, 0.1, -0.1, 0.0]) * 1e-6
    share = np.append([0.0, 1e-4], np.arange(1, 60) / 60)  # close to the turn, where a law may jump
    x = np.append((turns[:-1, None] + np.diff(turns)[:, None] * share).ravel(), turns[-1])
    time = np.append(0.0, np.cumsum(np.abs(np.diff(x)) / 2e-6))
    return x, ss.friction_response(law, time, x)["friction_force"].values


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/gallery"))
