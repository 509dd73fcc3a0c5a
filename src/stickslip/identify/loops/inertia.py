r"""Mass and friction of a body from the force that drives it and its motion, also in closed loop.

.. math:: F = m \ddot x + c\,\dot x + F_C \operatorname{sign} \dot x + F_0

Multiplied by smooth windows :math:`\varphi` that vanish with their slope at both ends and integrated by parts
[shinbrot1957], the recorded position is never differentiated:

.. math:: \int \varphi F = m \int \ddot\varphi x - c \int \dot\varphi x
          + F_C \int \varphi \operatorname{sign} \dot x + F_0 \int \varphi

which is linear in what is looked for. The force is the recorded one, so that a controller makes no
difference. A body that turns has an angle [rad] and a torque [N m], and then m is a moment of inertia.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ...estimate.coloured import with_inherited
from ...estimate.covariance import decomposed
from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError, Residuals
from ...estimate.result import Fit
from ...quantities.units import to_si, turned
from ...recording.noise import noise_level
from ..free import with_ties
from ..recorded.channels import channel, names_of, recordings_of, unit_of
from ..recorded.known_noise import NOTHING, more_than_white, white_noise
from ..recorded.screen import refuse_loop

# Number of windows that start within the length of one: they share little noise and leave little unused.
OVERLAP = 2
# Parts of a window over which the velocity is averaged for its sign; and standard deviations of its noise
# above which it has a sign.
SMOOTHED, AT_REST = 32, 3.0
FEWEST = 16  # samples of a window
DRAWS = 16  # of the position's noise

Array = NDArray[np.float64]
UNPREDICTED = (
    "it is of averages over a window, for the force at an instant needs the acceleration, which a recorded "
    "position does not show; its remarks say what the body leaves of the averages"
)
NAMES = ("mass", "viscous", "coulomb_force", "offset")
# Units of inertia, viscous and Coulomb friction.
UNITS = ("kg", "N s/m", "N")


def identify_inertia(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    window: float | str,
    position: str = "position",
    force: str = "force",
    tied: Mapping[str, str] | None = None,
) -> Fit:
    """Mass, viscous and Coulomb friction and an offset of the force, from force and motion.

    Args:
        recordings: with the position [m or rad] and the force [N or N m] that drives the body, at equal
            intervals.
        window: s, over which all is averaged: short against the changes of the motion, long against its
            noise; a quarter of the motion's period is a good choice.
        position, force: names of the channels.
        tied: parameters that follow from others, as for `identify_friction`; ``{"viscous": "'0 N s/m'"}`` is
            a body without it.

    Returns:
        A fit of mass [kg or kg m^2], viscous [N s/m or N m s/rad], coulomb_force and offset [N or N m]; the
        residuals are of the averaged force. The noise of the position counts in the uncertainty. Its
        `failures` name a mass or a viscous friction below zero, which a wrong sign or a late position makes.

    Raises:
        RecordingError: a channel is missing, too short, constant or noise, or the force does negative work.
        QuantityError: an expression that ties is wrong.
        FitError: the window has fewer than 16 samples, or is longer than a recording.
    """
    window = to_si(window, "s", "window")
    found = recordings_of(recordings)
    parts, moved, forces = [], [], []
    for recording, name in zip(found, names_of(found), strict=True):
        x = channel(recording, position, name, varies=True)
        f = channel(recording, force, name, varies=True)
        refuse_loop(x, f, name, (position, force), moves=True)
        averages = _Averages(recording["time"].values, window, name)
        parts.append((averages.design(x), averages.of(f), name))
        moved.append((averages, x))
        forces.append(f)
    turns = unit_of(found, position) == "rad"
    kilograms, viscous, newtons = map(turned, UNITS) if turns else UNITS
    begin = np.linalg.lstsq(
        np.concatenate([d for d, _, _ in parts]), np.concatenate([y for _, y, _ in parts]), rcond=None
    )[0]
    free = [
        Parameter(name, float(b), -np.inf, np.inf, u, log=False)
        for name, b, u in zip(NAMES, begin, (kilograms, viscous, newtons, newtons), strict=True)
    ]

    def residuals(design: Array, y: Array) -> Any:
        return lambda values: design @ _vector(values) - y

    fit = fit_least_squares(
        [Residuals(residuals(d, y), y, None, name, newtons) for d, y, name in parts],
        with_ties(free, tied),
        jacobian=lambda values: np.concatenate([d for d, _, _ in parts]),
    )
    shaken = _by_noise_of_position(fit, moved)
    fit = replace(
        with_inherited(fit, shaken, np.eye(DRAWS) / DRAWS), observed="force", unpredicted=UNPREDICTED
    )
    return replace(fit, doubts=_doubts(fit), remarks=_left(fit, forces, moved, shaken))


def _left(
    fit: Fit, forces: Sequence[Array], moved: Sequence[tuple[_Averages, Array]], shaken: Array
) -> tuple[str, ...]:
    """A sentence on each recording of which more is left than its noise leaves of averages of the force."""
    assert fit.jacobian is not None
    directions = decomposed(fit.jacobian)[0]
    shaken = shaken - directions @ (directions.T @ shaken)  # what a fit takes up is not left
    by_position = np.split(np.mean(shaken**2, axis=1), np.cumsum([a.begins.size for a, _ in moved])[:-1])
    said = []
    for g, left, drawn, force, (a, x) in zip(
        fit.recordings, fit.residuals, by_position, forces, moved, strict=True
    ):
        # Few draws have the signs that are not likely, of which one in many windows is to be expected.
        variance = np.maximum(drawn, a.unsure(x) * fit.values["coulomb_force"] ** 2)
        white = white_noise(force) * float(np.linalg.norm(a.shape))
        words = (g.name, g.unit, "averages", "another force acts, or the friction has another form")
        values = a.of(force)
        said.append(more_than_white(*_weighted(left, white**2 + variance, values), values, words))
    return tuple(filter(None, said))


def _weighted(left: Array, variance: Array, values: Array) -> tuple[float, float]:
    """Root mean squares of what is left of values [windows], and of its noise of this variance.

    One sample of the wrong sign may leave a window many times what noise leaves of the others. Weighted by
    the variance, such a window hides no misfit of the others.
    """
    least = NOTHING * float(np.ptp(values)) or 1.0
    weight = 1.0 / (variance + least**2)
    of_left, of_noise = (float(np.average(square, weights=weight)) for square in (left**2, variance))
    return math.sqrt(of_left), math.sqrt(of_noise)


def _doubts(fit: Fit) -> tuple[str, ...]:
    """Return sentences on impossible values, with the sign of the friction judged as a lack of fit."""
    if fit.values["mass"] < 0.0:
        return ("the mass is negative: the force or the position has the wrong sign",)
    if fit.confidence_intervals(1.0 - 2.0 * fit.judgement.false_alarm)["viscous"][1] < 0.0:
        return ("viscous friction is negative: the position is late, or another force drives the body",)
    return ()


def _vector(values: Values) -> Array:
    return np.array([values[name] for name in NAMES])


def _by_noise_of_position(fit: Fit, moved: Sequence[tuple[_Averages, Array]]) -> Array:
    """Return the effect of the position's noise, seen in its fourth differences, on the averages [windows,
    draws].

    A body that passes rest has a sign in each sample, though the design may have none: so have the draws.
    """
    random, vector = np.random.default_rng(0), _vector(fit.values)
    columns = []
    for _ in range(DRAWS):
        changed = []
        for averages, x in moved:
            noisy = x + noise_level(x) * random.standard_normal(x.size)
            changed.append((averages.design(noisy, passes=True) - averages.design(x)) @ vector)
        columns.append(np.concatenate(changed))
    return np.column_stack(columns)


def _exact(weights: Array, shape: Array, s: Array, moments: Sequence[float]) -> Array:
    """The weights, changed in proportion to the window's shape, with these moments of 1, s - 1/2 and its
    square: those of the integrals. The sums of few samples have others, by which a place is a force."""
    powers = (s - 0.5) ** np.arange(3)[:, None]
    missing = np.linalg.solve((powers * shape) @ powers.T, moments - powers @ weights)
    return weights + shape * (missing @ powers)


class _Averages:
    """Integrals over windows of one recording, each over the integral of the window."""

    def __init__(self, time: Array, window: float, where: str) -> None:
        interval = float(time[-1] - time[0]) / (time.size - 1)
        size = round(window / interval)
        if size < FEWEST or size > time.size:
            raise FitError(
                f"a window of {window:g} s has {size} samples of the {time.size} of {where}: it needs at "
                f"least {FEWEST}, and no more than there are"
            )
        s = np.arange(size + 1) / size
        shape = s**4 * (1.0 - s) ** 4
        slope = 4.0 * s**3 * (1.0 - s) ** 3 * (1.0 - 2.0 * s)
        bend = 12.0 * s**2 * (1 - s) ** 2 * (1 - 2 * s) ** 2 - 8.0 * s**3 * (1 - s) ** 3
        whole = float(shape.sum())
        slope, bend = (
            _exact(slope, shape, s, [0.0, -whole, 0.0]),
            _exact(bend, shape, s, [0.0, 0.0, 2.0 * whole]),
        )
        length = size * interval
        self.size, self.smooth = size + 1, max(3, size // SMOOTHED) | 1
        self.shape, self.slope, self.bend = shape / whole, slope / whole / length, bend / whole / length**2
        self.begins = np.arange(0, time.size - size, max(1, size // OVERLAP))

    def _windows(self, values: Array) -> Array:
        return values[self.begins[:, None] + np.arange(self.size)]

    def of(self, values: Array) -> Array:
        """Averages of a channel [windows]."""
        return self._windows(values) @ self.shape

    def _sign(self, position: Array, *, passes: bool = False) -> Array:
        """Return the sign of the velocity: 0 if uncertain; with `passes`, the sign at a body that passes
        rest."""
        velocity = uniform_filter1d(np.gradient(position), self.smooth, mode="nearest")
        sign = np.sign(velocity)
        if not passes:
            # Error of the mean and the differences for a curved velocity: a second mean shows two thirds.
            curved = 1.5 * np.abs(uniform_filter1d(velocity, self.smooth, mode="nearest") - velocity)
            sign[np.abs(velocity) <= AT_REST * noise_level(position) / self.smooth + curved] = 0.0
        return sign

    def design(self, position: Array, *, passes: bool = False) -> Array:
        """Return acceleration, velocity, its sign (see `_sign`), and one: [windows, 4]."""
        x, sign = self._windows(position), self._sign(position, passes=passes)
        return np.column_stack([x @ self.bend, -x @ self.slope, self.of(sign), np.ones(self.begins.size)])

    def unsure(self, position: Array) -> Array:
        """Variance of the average sign, if the signs that are not sure were each drawn [windows]."""
        return self._windows(self._sign(position) == 0.0) @ self.shape**2
