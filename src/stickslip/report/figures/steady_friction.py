"""Figure of steady friction over velocity: points and the fitted law."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...friction import Stribeck
from .scale import scale_for
from .style import BLUE, MEASURED, drawn, legend_above, panels, trace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DRAWN = 400  # number of points of the law's curve


@drawn
def steady_friction(velocity: ArrayLike, force: ArrayLike, law: Stribeck) -> Figure:
    """Draw the magnitude of the friction force over the magnitude of the velocity; below, the residuals.

    The velocity's axis is logarithmic. Residuals are law minus measured.

    Args:
        velocity: m/s, shape (n,); points at 0 are left out.
        force: N, shape (n,), after subtraction of the sensor's offset.
        law: the fitted law.
    """
    v, f = np.asarray(velocity, float), np.asarray(force, float)
    v, f = np.abs(v[v != 0.0]), (np.sign(v) * f)[v != 0.0]
    curve = np.geomspace(v.min(), v.max(), _DRAWN)
    figure, axes = panels((2.6, 1.2))
    scale, speed = scale_for("N", f), scale_for("m/s", v)
    axes[0].plot(speed(v), scale(f), "o", color=MEASURED, ms=4.0, label="measured")
    trace(axes[0], speed(curve), scale(_friction(curve, law)), color=BLUE, lw=1.4, label="Stribeck curve")
    left = _friction(v, law) - f
    small = scale_for("N", left)
    axes[1].axhline(0.0, color="#404040", lw=0.7)
    axes[1].plot(speed(v), small(left), "o", color=BLUE, ms=3.5)
    for panel in axes:
        panel.set_xscale("log")
    axes[0].set_ylabel(scale.label("friction force"))
    axes[1].set_ylabel(small.label("residual"))
    axes[1].set_xlabel(speed.label("velocity"))
    legend_above(axes[0])
    return figure


def _friction(v: np.ndarray, law: Stribeck) -> np.ndarray:
    fall = np.exp(-((v / law.stribeck_velocity) ** law.exponent))
    return law.coulomb_force + (law.stiction_force - law.coulomb_force) * fall + law.sigma_2 * v
