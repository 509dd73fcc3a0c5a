r"""Response to a step of the drive behind a piezo with hysteresis and creep: a sum of ramps and lags.

While the drive moves in one direction, the plays' output is linear between the voltages at which a play
starts to move. So a step, or the ramp that an amplifier makes of it, becomes a sum of ramps. Creep adds the
response of each of its terms, :math:`a_k / (1 + \tau_k s)`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...physics.piezo import Creep, Piezo, PrandtlIshlinskii
from ...quantities.units import QuantityError
from .linear import one_of_pairs, residues

Array = NDArray[np.float64]


class VoltageRamp(NamedTuple):
    """A linear part of the step behind the hysteresis: its `height` [V], its start `begin` after the step
    [s], and its duration `rise` [s], 0 for a jump."""

    height: float
    begin: float
    rise: float


def check_known(piezo: Piezo | None) -> None:
    """Raise QuantityError for a piezo model whose steps have no closed form: a hysteresis other than
    `PrandtlIshlinskii`, or a creep other than `Creep`."""
    if piezo is None:
        return
    for part, known in ((piezo.hysteresis, PrandtlIshlinskii), (piezo.creep, Creep)):
        if part is not None and not isinstance(part, known):
            raise QuantityError(
                f"steps through a {type(part).__name__} have no closed form here: a model with a piezo needs "
                "a PrandtlIshlinskii and a Creep"
            )


def ramps(piezo: Piezo | None, voltage: float, rest: float, slew_rate: float | None) -> list[VoltageRamp]:
    """Return the ramps, in order of time, that a step becomes behind the hysteresis of a piezo.

    Args:
        piezo: model of the piezo; None: no hysteresis.
        voltage: height of the step, V.
        rest: voltage before the step, V, reached from 0 V.
        slew_rate: slew rate of the step, V/s; None: the step is a jump, and the result is one jump.
    """
    path, levels = np.array([rest, rest + voltage]), np.array([rest, rest + voltage])
    if piezo is not None and piezo.hysteresis is not None:
        law = piezo.hysteresis
        corners = law.corners(rest, float(np.sign(voltage)))
        along = np.sort(np.abs(corners[(corners - rest) * np.sign(voltage) > 0.0] - rest))
        inside = along[along < abs(voltage)]
        path = rest + np.sign(voltage) * np.unique(np.concatenate([[0.0], inside, [abs(voltage)]]))
        levels = law.output(path, rest)
    if not slew_rate:
        return [VoltageRamp(float(levels[-1] - levels[0]), 0.0, 0.0)]
    times = np.abs(path - rest) / slew_rate
    return [
        VoltageRamp(float(h1 - h0), float(t0), float(t1 - t0))
        for (h0, h1), (t0, t1) in zip(pairwise(levels), pairwise(times), strict=True)
    ]


def response(
    piezo: Piezo | None, slew_rate: float | None
) -> Callable[[Array, float, float, list[complex], list[complex]], Array]:
    """Return a function for the step response of linear dynamics behind the piezo.

    The function's arguments are times after the step [s], height of the step [V], voltage before it [V], and
    poles and zeros of the dynamics [rad/s]. It returns the response [n] for a static gain of 1, in V.
    """
    known: dict[tuple[float, float], list[VoltageRamp]] = {}
    creep = None if piezo is None else piezo.creep

    def of(time: Array, voltage: float, rest: float, poles: list[complex], zeros: list[complex]) -> Array:
        if (voltage, rest) not in known:
            known[voltage, rest] = ramps(piezo, voltage, rest, slew_rate)
        parts = known[voltage, rest]
        level, c, p = _with_creep(creep, *residues(poles, zeros))
        c, p = one_of_pairs(c, p)
        height, begin, rise = np.array(parts).T[:, :, None]
        found, end = np.zeros(time.size), parts[-1].begin + parts[-1].rise
        rising, later = (time > 0.0) & (time < end), time >= end

        def integral(since: Array) -> Array:
            """Return the integral over time, V s, of the response to a step of 1 V, at times since the step
            [s]; 0 before."""
            after = np.maximum(since, 0.0)
            return level * after + np.real(np.expm1(after[..., None] * p) @ (c / p))

        if np.any(rising):
            t = time[rising]
            found[rising] = (height / rise * (integral(t - begin) - integral(t - begin - rise))).sum(axis=0)
        # After the last ramp only the exponentials remain, each multiplied by one factor for each ramp. Their
        # times count from the end of the last ramp, so that the factors of fast poles do not overflow.
        ramped = np.exp(p * (end - begin - rise)) * np.expm1(p * rise) / (p * rise) if end > 0.0 else 1.0
        factors = (height * ramped).sum(axis=0)
        found[later] = level * height.sum() + np.real(np.exp(np.outer(time[later] - end, p)) @ (c * factors))
        return found

    return of


def _with_creep(creep: Creep | None, c: NDArray, p: NDArray) -> tuple[float, NDArray, NDArray]:
    """Return the final value, and coefficients and poles [1/s] of the decaying exponentials, of the unit step
    response of dynamics behind creep. `c` and `p` are those of the dynamics alone; creep None changes
    nothing."""
    if creep is None:
        return 1.0, c, p
    tau, shares = np.array(creep.time_constants), np.array(creep.shares)
    behind = c / (1.0 + tau[:, None] * p)
    own = -1.0 - behind.sum(axis=1)  # coefficient of each creep term, whose response must start at 0
    return (
        1.0 + float(shares.sum()),
        np.append(c + shares @ behind, shares * own),
        np.append(p, -1.0 / tau),
    )
