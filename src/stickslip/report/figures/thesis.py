"""Figures of the thesis [kang2007], drawn from the package's laws and simulations.

Figures 2.1, 2.4, 3.1-3.4 and 3.7 reproduce figures of the thesis. `walk`, `there_and_back` and
`friction_loops` show what the thesis describes in words. Comments give values that the thesis does not print.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ...friction import LuGre, breakaway, rate
from ...friction.elastoplastic import Elastoplastic, plastic_share
from ...simulation import friction_response
from ...waveform.signal import Waveform, value_at
from .scale import scale_for
from .style import BLACK, BLUE, DASHES, GREEN, MEASURED, SERIES, VERMILLION, WIDTH, drawn, panels, trace

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

# Friction law and motion of fig. 3.1-3.4. Sec. 3.2.3 gives sigma_0 = 600, sigma_1 = 100 and sigma_2 = 25 per
# micrometre, and F_C = 10 N. It calls the motion "parabolic": x = a t^2/2, with the acceleration PARABOLA
# (a, m/s^2) chosen so that each statement of its text is reproduced. Only the products sigma_1^2 a and
# sigma_2^2 a matter, so another unit of sigma_1 and sigma_2 is equivalent to another a.
DEMONSTRATION = LuGre("600 N/um", "100 N s/um", "25 N s/um", 10.0, 10.0)  # type: ignore[arg-type]
PARABOLA = 30e-6
_REACH = 0.2e-6  # final displacement of the demonstration, m: twelve presliding distances F_C / sigma_0


def demonstration(samples: int = 4001) -> dict[str, xr.Dataset]:
    """Simulate LuGre friction under a given motion, with four settings of damping.

    The displacement is the parabola x = a t²/2 with `samples` samples. Return the responses, datasets over
    time with position and friction force, by the thesis's figure number ("3.1" to "3.4").
    """
    time = np.linspace(0.0, np.sqrt(2.0 * _REACH / PARABOLA), samples)
    laws = {
        "3.1": DEMONSTRATION._replace(sigma_2=0.0),
        "3.2": DEMONSTRATION._replace(sigma_1=0.0),
        "3.3": DEMONSTRATION._replace(sigma_1=0.0, sigma_2=0.0),
        "3.4": DEMONSTRATION,
    }
    return {name: friction_response(law, time, 0.5 * PARABOLA * time**2) for name, law in laws.items()}


@drawn
def static_laws(laws: Mapping[str, Any], speed: float) -> Figure:
    """Draw fig. 2.1: friction force over sliding velocity, with the range of possible forces at rest.

    Args:
        laws: static laws by title, four or fewer; each has a panel.
        speed: largest velocity in both directions, m/s.
    """
    figure = Figure(figsize=(WIDTH, 4.6))
    axes = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    v = np.linspace(0.0, speed, 400)[1:]
    moving = {name: np.array([rate(law, one, 1.0)[0] for one in v]) for name, law in laws.items()}
    velocity, force = scale_for("m/s", v), scale_for("N", *moving.values())
    for panel, (name, law) in zip(axes, laws.items(), strict=False):
        held = breakaway(law)
        for way in (1.0, -1.0):
            trace(panel, velocity(way * v), force(way * moving[name]), color=BLUE)
            # The force of this law drops when sliding starts; a hollow point marks the force just after.
            if moving[name][0] < 0.99 * held:
                panel.plot(0.0, force(way * moving[name][0]), "o", mfc="white", mec=BLUE, zorder=3)
        panel.plot([0.0, 0.0], force([-held, held]), color=VERMILLION, lw=2.4, solid_capstyle="butt")
        panel.set_title(name, loc="left")
    axes[0].annotate(
        "at rest: any force\nup to breakaway",
        (0.0, 0.0),
        (0.06, 0.75),
        textcoords="axes fraction",
        color=VERMILLION,
        fontsize=8,
        arrowprops={"arrowstyle": "-", "color": VERMILLION, "lw": 0.7},
    )
    for panel in axes[2:]:
        panel.set_xlabel(velocity.label("sliding velocity"))
    for panel in axes[::2]:
        panel.set_ylabel(force.label("friction force"))
    return figure


@drawn
def plastic_share_over_deflection(law: Elastoplastic, speed: float = 1e-4) -> Figure:
    """Draw fig. 2.4: alpha(z, v), the sliding fraction of a motion, over the bristle's deflection z.

    Args:
        law: elastoplastic law, which gives sigma_0, Coulomb force and breakaway deflection.
        speed: magnitude of the sliding velocity v, m/s; both directions are drawn.
    """
    z_ss, z_ba = law.coulomb_force / law.sigma_0, law.breakaway_deflection
    z = np.linspace(-1.5 * z_ss, 1.5 * z_ss, 1201)
    figure, (panel,) = panels([2.6])
    deflection = scale_for("m", z)
    for way, colour, dashes, label in (
        (1.0, BLUE, DASHES[0], "v > 0"),
        (-1.0, VERMILLION, DASHES[1], "v < 0"),
    ):
        share = [plastic_share(way * speed, one, z_ba, z_ss) for one in z]
        trace(panel, deflection(z), share, color=colour, ls=dashes, label=label)
    marks = {"$-z_{ss}$": -z_ss, "$-z_{ba}$": -z_ba, "$z_{ba}$": z_ba, "$z_{ss}$": z_ss}
    for name, place in marks.items():
        panel.axvline(float(deflection(place)), color="#909090", lw=0.6, ls=DASHES[2])
        panel.annotate(
            name,
            (float(deflection(place)), 1.0),
            (2, 3),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            fontsize=8,
        )
    panel.set_xlabel(deflection.label("deflection of the bristle z"))
    panel.set_ylabel("plastic share α")
    panel.legend(loc="center")
    return figure


@drawn
def under_the_parabola(responses: Mapping[str, xr.Dataset]) -> Figure:
    """Draw fig. 3.1-3.4: friction force over displacement, one panel per setting; F_C as a grey line.

    Args:
        responses: result of `demonstration`.
    """
    settings = {
        "3.1": "σ₁ alone: overshoot, then F_C",
        "3.2": "σ₂ alone: rises with the velocity",
        "3.3": "neither: Dahl",
        "3.4": "σ₁ and σ₂: peak, fall, rise",
    }
    figure = Figure(figsize=(WIDTH, 4.6))
    axes = figure.subplots(2, 2, sharex=True).ravel()
    way = scale_for("m", *(one["position"].values for one in responses.values()))
    for panel, (name, one) in zip(axes, responses.items(), strict=False):
        panel.axhline(DEMONSTRATION.coulomb_force, color=MEASURED, lw=0.9)
        trace(panel, way(one["position"].values), one["friction_force"].values, color=BLUE)
        panel.set_title(f"{name}  {settings.get(name, '')}", loc="left")
        panel.set_ylim(bottom=0.0)
    for panel in axes[2:]:
        panel.set_xlabel(way.label("displacement"))
    for panel in axes[::2]:
        panel.set_ylabel("friction force (N)")
    return figure


@drawn
def drive_signals(waveforms: Mapping[str, Waveform], duration: float) -> Figure:
    """Draw fig. 3.7: drive voltage over time from 0 to `duration` [s], a panel for each waveform by title.

    Jumps of the voltage are vertical lines.
    """
    figure, axes = panels([1.35] * len(waveforms))
    clock = scale_for("s", duration)
    for panel, (name, waveform) in zip(axes, waveforms.items(), strict=True):
        edges = np.append(waveform.drive(duration).start, duration)
        time = np.concatenate([[a, b * (1.0 - 1e-12)] for a, b in pairwise(edges)])
        trace(panel, clock(time), value_at(waveform, time), color=BLUE)
        panel.set_title(name, loc="left")
        panel.set_ylabel("drive (V)")
        panel.set_xlim(0.0, float(clock(duration)))
    axes[-1].set_xlabel(clock.label("time"))
    return figure


_ROWS: tuple[tuple[str, tuple[tuple[str, str, str, Any], ...]], ...] = (
    ("drive", (("drive_voltage", "drive", BLACK, DASHES[0]),)),
    (
        "position",
        (
            ("stage_position", "stage", BLUE, DASHES[1]),
            ("end_effector_position", "end-effector", VERMILLION, DASHES[0]),
        ),
    ),
    ("sliding", (("sliding_displacement", "stage less end-effector", GREEN, DASHES[0]),)),
    ("friction", (("friction_force", "friction", BLACK, DASHES[0]),)),
)


@drawn
def walk(recording: xr.Dataset, zoom: tuple[float, float], friction: float | None = None) -> Figure:
    """Draw drive, positions, sliding and friction force of an actuator over time; at the right, one flyback.

    Args:
        recording: result of `simulate`.
        zoom: start and end of the time in the right column, s; the recording needs many samples there.
        friction: force to mark in both directions by lines, such as F_C, N; None: no lines.
    """
    figure = Figure(figsize=(WIDTH, 6.4))
    grid = figure.subplots(
        len(_ROWS), 2, sharex="col", sharey="row", width_ratios=(3, 2), height_ratios=(1, 2, 1.5, 1.5)
    )
    time = recording["time"].values
    inside = (time >= zoom[0]) & (time <= zoom[1])
    spans = (slice(None), scale_for("s", time)), (inside, scale_for("s", time[inside] - zoom[0]))
    for row, (name, variables) in zip(grid, _ROWS, strict=True):
        scale = scale_for(
            str(recording[variables[0][0]].attrs["units"]), *(recording[v[0]].values for v in variables)
        )
        for panel, (part, clock), start in zip(row, spans, (0.0, zoom[0]), strict=True):
            if name == "friction" and friction is not None:
                for level in (friction, -friction):
                    panel.axhline(float(scale(level)), color=MEASURED, lw=0.8)
            for variable, label, colour, dashes in variables:
                values = scale(recording[variable].values[part])
                trace(panel, clock(time[part] - start), values, color=colour, ls=dashes, label=label)
        row[0].set_ylabel(scale.label(name))
    grid[1, 0].legend(loc="upper left")
    grid[-1, 0].set_xlabel(spans[0][1].label("time"))
    grid[-1, 1].set_xlabel(spans[1][1].label("time after the flyback" if zoom[0] else "time"))
    figure.align_ylabels(grid[:, 0])
    return figure


@drawn
def there_and_back(recording: xr.Dataset) -> Figure:
    """Draw drive voltage and end-effector position over time, for a walk forward, a rest and a walk back.

    `recording` is a result of `simulate`.
    """
    figure, axes = panels([1.3, 2.4])
    clock = scale_for("s", recording["time"].values)
    rows = (("drive_voltage", "drive", BLACK), ("end_effector_position", "end-effector", VERMILLION))
    for panel, (variable, label, colour) in zip(axes, rows, strict=True):
        scale = scale_for(str(recording[variable].attrs["units"]), recording[variable].values)
        trace(panel, clock(recording["time"].values), scale(recording[variable].values), color=colour)
        panel.set_ylabel(scale.label(label))
    axes[-1].axhline(0.0, color=MEASURED, lw=0.8)
    axes[-1].set_xlabel(clock.label("time"))
    return figure


@drawn
def friction_loops(loops: Mapping[str, tuple[ArrayLike, ArrayLike]]) -> Figure:
    """Draw friction force over displacement, a small panel for each law, three in a row.

    Args:
        loops: displacement [m] and force [N] of each law, arrays (n,), by title.
    """
    columns = 3
    rows = -(-len(loops) // columns)
    figure = Figure(figsize=(WIDTH, 1.9 * rows + 0.3))
    axes = np.atleast_2d(figure.subplots(rows, columns, sharex=True, sharey=True))
    way = scale_for("m", *(x for x, _ in loops.values()))
    force = scale_for("N", *(f for _, f in loops.values()))
    panel: Axes
    for i, (panel, (name, (x, f))) in enumerate(zip(axes.ravel(), loops.items(), strict=False)):
        trace(panel, way(x), force(f), color=SERIES[0], lw=0.9)
        panel.set_title(name, loc="left")
        if i % columns == 0:
            panel.set_ylabel(force.label("force"))
        if i >= len(loops) - columns:
            panel.set_xlabel(way.label("displacement"))
            panel.tick_params(labelbottom=True)
    for panel in axes.ravel()[len(loops) :]:
        panel.remove()
    return figure
