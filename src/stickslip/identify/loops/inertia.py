r"""Mass and friction of a body from the force that drives it and its motion, also under feedback.

.. math:: F = m \ddot x + c\,\dot x + F_C \operatorname{sign} \dot x + F_0

F is the force and x the position; m is the mass, c the viscous friction, F_C the Coulomb force and F_0 a
constant force. Multiplied by smooth windows :math:`\varphi` that vanish with their slope at both ends and
integrated by parts [shinbrot1957], the recorded position is never differentiated:

.. math:: \int \varphi F = m \int \ddot\varphi x - c \int \dot\varphi x
          + F_C \int \varphi \operatorname{sign} \dot x + F_0 \int \varphi

which is linear in the unknown values. The recorded force is used, so a controller does not matter. For a
rotary body, x is an angle [rad], F a torque [N m] and m a moment of inertia.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.coloured import with_inherited
from ...estimate.covariance import decomposed
from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Parameter, Values
from ...estimate.problem import FitError, Residuals
from ...estimate.result import Fit
from ...quantities.units import coordinate_of, to_si
from ...recording.noise import noise_level
from ..free import with_ties
from ..recorded.channels import channel, names_of, recordings_of, unit_of
from ..recorded.known_noise import NOTHING, more_than_white, white_noise
from ..recorded.screen import refuse_loop

if TYPE_CHECKING:
    import xarray as xr

# Number of averaging windows that start within the length of one window. Two half-overlapping windows share
# little noise and use most of the data.
OVERLAP = 2
# SMOOTHED: the velocity is averaged over 1/32 of a window before its sign is taken. AT_REST: a velocity below
# this number of standard deviations of its noise has the sign 0.
SMOOTHED, AT_REST = 32, 3.0
FEWEST = 16  # fewest sampling intervals in a window
DRAWS = 16  # number of random draws of the position's noise

Array = NDArray[np.float64]
UNPREDICTED = (
    "it is of averages over a window, for the force at an instant needs the acceleration, which a recorded "
    "position does not show; its remarks say what the body leaves of the averages"
)
NAMES = ("mass", "viscous", "coulomb_force", "offset")
# Units of mass, viscous friction and Coulomb friction (also of the offset) for a linear motion.
UNITS = ("kg", "N s/m", "N")


def identify_inertia(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    window: float | str,
    position: str = "position",
    force: str = "force",
    tied: Mapping[str, str] | None = None,
) -> Fit:
    """Fit mass, viscous friction, Coulomb friction and an offset of the force to recorded force and motion.

    Args:
        recordings: with the position [m or rad] and the force [N or N m] that drives the body, at equal
            intervals.
        window: length of the averaging windows, s: shorter than the changes of the motion and longer than
            those of its noise; a quarter of the motion's period is a good choice.
        position, force: names of the position and force channels.
        tied: parameters that follow from others, as for `identify_friction`; ``{"viscous": "'0 N s/m'"}`` is
            a body without viscous friction.

    Returns:
        A fit of mass [kg or kg m^2], viscous [N s/m or N m s/rad], coulomb_force and offset [N or N m]; the
        residuals are those of the averaged force. The uncertainty includes the noise of the position.
        `failures` of the fit name a mass or viscous friction below zero: the sign of a channel is wrong, or
        the position is delayed. `remarks` name recordings that the model does not explain.

    Raises:
        RecordingError: a channel is missing, too short, constant or noise, or the force does negative work.
        QuantityError: an expression in `tied` is wrong.
        FitError: the window has fewer than 16 sampling intervals, or is longer than a recording.
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
    kilograms, viscous, newtons = map(coordinate_of(unit_of(found, position)).unit, UNITS)
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
    """Return a sentence on each recording whose residual of the averaged force exceeds the effect of the
    noise of force and position.

    Args:
        fit: fit of the averages.
        forces: recorded force of each recording, [n].
        moved: averages and recorded position of each recording.
        shaken: effect of the position's noise, from `_by_noise_of_position`.
    """
    assert fit.jacobian is not None
    directions = decomposed(fit.jacobian)[0]
    # The fitted values absorb a part of the noise's effect, so this part is not in the residual.
    shaken = shaken - directions @ (directions.T @ shaken)
    by_position = np.split(np.mean(shaken**2, axis=1), np.cumsum([a.begins.size for a, _ in moved])[:-1])
    said = []
    for g, left, drawn, force, (a, x) in zip(
        fit.recordings, fit.residuals, by_position, forces, moved, strict=True
    ):
        # A few random draws rarely contain an unlikely sign of the velocity, but some of many windows do. So
        # the variance of the uncertain signs is a lower limit.
        variance = np.maximum(drawn, a.unsure(x) * fit.values["coulomb_force"] ** 2)
        white = white_noise(force) * float(np.linalg.norm(a.shape))
        words = (g.name, g.unit, "averages", "another force acts, or the friction has another form")
        values = a.of(force)
        said.append(more_than_white(*_weighted(left, white**2 + variance, values), values, words))
    return tuple(filter(None, said))


def _weighted(left: Array, variance: Array, values: Array) -> tuple[float, float]:
    """Return two weighted root mean squares, N (N m): of residuals, and of the noise with this variance.

    One sample of the velocity with the wrong sign can make the residual of one window many times larger.
    Weighted by the inverse variance, such a window hides no misfit of the others.

    Args:
        left: residual of the averaged force in each window, [windows].
        variance: variance of the noise of each average, [windows].
        values: averaged forces, whose range sets a smallest standard deviation, [windows].
    """
    least = NOTHING * float(np.ptp(values)) or 1.0
    weight = 1.0 / (variance + least**2)
    of_left, of_noise = (float(np.average(square, weights=weight)) for square in (left**2, variance))
    return math.sqrt(of_left), math.sqrt(of_noise)


def _doubts(fit: Fit) -> tuple[str, ...]:
    """Return a tuple with one sentence on a negative mass or viscous friction; empty if both are possible.
    Viscous friction counts as negative if its whole confidence interval is below 0, at the false-alarm
    probability of the lack-of-fit tests."""
    if fit.values["mass"] < 0.0:
        return ("the mass is negative: the force or the position has the wrong sign",)
    if fit.confidence_intervals(1.0 - 2.0 * fit.judgement.false_alarm)["viscous"][1] < 0.0:
        return ("viscous friction is negative: the position is late, or another force drives the body",)
    return ()


def _vector(values: Values) -> Array:
    return np.array([values[name] for name in NAMES])


def _by_noise_of_position(fit: Fit, moved: Sequence[tuple[_Averages, Array]]) -> Array:
    """Return the changes of the predicted average force, N (N m), by random noise of the position, shape
    (windows of all recordings, draws).

    The noise has the level that the position itself shows (`noise_level`). In the noisy positions the sign of
    every velocity counts, also where the design matrix takes it as uncertain.

    Args:
        fit: fit of the averages.
        moved: averages and recorded position of each recording.
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
    """Return the weights [n] of a window's samples, corrected so that their sums with 1, s - 1/2 and (s -
    1/2)^2 equal the integrals. Otherwise, for few samples, a constant position would look like a force.

    Args:
        weights: window function, or a derivative of it, at the samples, [n].
        shape: window function at the samples, [n]; the correction is proportional to it.
        s: position of the samples in the window, 0 to 1, [n].
        moments: the three sums that the weights must have.
    """
    powers = (s - 0.5) ** np.arange(3)[:, None]
    missing = np.linalg.solve((powers * shape) @ powers.T, moments - powers @ weights)
    return weights + shape * (missing @ powers)


class _Averages:
    """Weighted averages over overlapping windows of one recording: integrals of a channel times a window
    function (or its derivative), each divided by the integral of the window function.

    Args:
        time: times of the samples, s, at equal intervals.
        window: length of a window, s.
        where: name of the recording in errors.

    Raises:
        FitError: the window has fewer than `FEWEST` sampling intervals, or is longer than the recording.
    """

    def __init__(self, time: Array, window: float, where: str) -> None:
        interval = float(time[-1] - time[0]) / (time.size - 1)
        size = round(window / interval)
        # A window has a sample at both of its ends, so one sample more than intervals.
        if size < FEWEST or size >= time.size:
            raise FitError(
                f"a window of {window:g} s spans {size} of the {time.size - 1} sampling intervals of "
                f"{where}: it needs at least {FEWEST}, and no more than there are"
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
        """Return the averages of a channel, in its unit, shape (windows,)."""
        return self._windows(values) @ self.shape

    def _sign(self, position: Array, *, passes: bool = False) -> Array:
        """Return the sign of the smoothed velocity at each sample, -1 or 1, shape (n,); 0 where noise or
        curvature make it uncertain. With `passes` no sign is treated as uncertain."""
        velocity = scipy.ndimage.uniform_filter1d(np.gradient(position), self.smooth, mode="nearest")
        sign = np.sign(velocity)
        if not passes:
            # A moving mean of a curved velocity, and differences of the position, have an error. A second
            # moving mean changes the velocity by two thirds of this error.
            curved = 1.5 * np.abs(
                scipy.ndimage.uniform_filter1d(velocity, self.smooth, mode="nearest") - velocity
            )
            sign[np.abs(velocity) <= AT_REST * noise_level(position) / self.smooth + curved] = 0.0
        return sign

    def design(self, position: Array, *, passes: bool = False) -> Array:
        """Return the design matrix, shape (windows, 4): the averages of acceleration, velocity, sign of the
        velocity and 1, which mass, viscous friction, Coulomb friction and offset multiply.

        `position` contains the samples, m (rad); for `passes` see `_sign`.
        """
        x, sign = self._windows(position), self._sign(position, passes=passes)
        return np.column_stack([x @ self.bend, -x @ self.slope, self.of(sign), np.ones(self.begins.size)])

    def unsure(self, position: Array) -> Array:
        """Return the variance of the average sign of the velocity, shape (windows,), if each uncertain sign
        is -1 or 1 at random."""
        return self._windows(self._sign(position) == 0.0) @ self.shape**2
