r"""Friction of a slider that is pulled through a spring, from its stick-slip events.

While the slider sticks, the spring force grows at the rate stiffness times pulling speed. When it exceeds
stiction, the slider slips and the force drops. So the mean highest force, lowest force and period of the
events determine static and dynamic friction. The same features are extracted from the measurement and from
the simulation. Forces are divided by the slider's weight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.fit import fit_least_squares
from ...estimate.parameter import Parameter
from ...estimate.problem import FitError, Residuals
from ...estimate.quantiles import reach
from ...estimate.result import Fit
from ...friction import StictionCoulombViscous
from ...physics.actuator import STANDARD_GRAVITY, PulledSlider
from ...quantities.records import Quantity, record
from ...quantities.units import with_prefix
from ...recording.noise import noise_level
from ...simulation import simulate
from ...waveform.shapes import Ramp
from ..free import with_ties
from ..recorded.screen import refuse_loading
from .mean_covariance import covariance_of_mean, degrees_of_freedom

if TYPE_CHECKING:
    import xarray as xr

# Smallest drop of the force that is an event, as a share of the mean force; it must exceed the noise, too.
_EVENT = 0.08
# Largest mean time between events, in natural periods of the slider on its spring, of the "inertial" regime,
# in which the slider hardly sticks between its oscillations.
INERTIAL = 2.0
# Events are faster than physics allows if their mean period is shorter than the free period by more than the
# share QUICKER, beyond SURE standard errors of the mean.
QUICKER, SURE = 0.02, 3.0
# Smallest number of events in the used, stationary part of a simulation, and as many before this part.
_EVENTS = 12
# Fewest times between events from which the scatter of events is estimated.
_LEAST = 10
# Number of simulated events with random noise that estimate the shift of the means by noise, in multiples of
# the recorded events.
_NOISY = 10
UNPREDICTED = "it is of the means of events; a simulated PulledSlider with its coefficients has such events"


@record
class PulledRig(NamedTuple):
    """Set-up of the experiment: mass of the slider, stiffness of the spring, and speed of the spring's far
    end."""

    mass: Annotated[float, Quantity("kg", "m", "mass of the slider", above=0.0)]
    stiffness: Annotated[float, Quantity("N/m", "k", "stiffness of the spring", above=0.0)]
    speed: Annotated[float, Quantity("m/s", "v", "speed of the far end of the spring", above=0.0)]

    @property
    def weight(self) -> float:
        """Return the weight of the slider, N."""
        return self.mass * STANDARD_GRAVITY

    @property
    def loading_rate(self) -> float:
        """Return the growth of the spring force per second while the slider sticks, relative to the slider's
        weight, 1/s."""
        return self.stiffness * self.speed / self.weight

    @property
    def natural_frequency(self) -> float:
        """Return the natural angular frequency of the slider on its spring without friction, rad/s."""
        return math.sqrt(self.stiffness / self.mass)


@dataclass(frozen=True)
class Events:
    """Stick-slip events of one recording.

    Fields: `top` and `bottom`, spring force over the weight before and after the drop of each event,
    [events]; `period`, the times between successive drops, s, [events - 1] (a drop's moment is that at which
    the force falls through the middle); `sticking`, the share of the time in which the force grows as in
    stick; `free_period` [s] of the slider on its spring without friction.
    """

    top: NDArray[np.float64]
    bottom: NDArray[np.float64]
    period: NDArray[np.float64]
    sticking: float
    free_period: float

    @property
    def regime(self) -> str:
        """Return the regime of the motion: "stick-slip", "inertial" (oscillating, with hardly any stick) or
        "steady" (no events).

        A slip lasts at most one free period. So the slider sticks most of the time if events are more than
        two free periods apart.
        """
        if self.period.size == 0:
            return "steady"
        return "stick-slip" if float(np.mean(self.period)) > INERTIAL * self.free_period else "inertial"

    @property
    def impossible(self) -> str:
        """Return a sentence if events follow each other faster than the slider could oscillate on its spring;
        else an empty text.

        Friction can only delay the slider: with stick between its oscillations it is never faster than
        without friction.
        """
        if self.period.size < 3:
            return ""
        mean = float(np.mean(self.period))
        error = float(np.std(self.period, ddof=1)) / math.sqrt(self.period.size)
        if mean + SURE * error >= (1.0 - QUICKER) * self.free_period:
            return ""
        return (
            f"events come every {with_prefix(mean, 's', 3)}, quicker than the free period "
            f"{with_prefix(self.free_period, 's', 3)} of this mass and stiffness: one of them is wrong, "
            f"stiffness over mass by a factor of {(self.free_period / mean) ** 2:.3g} or more"
        )

    def summary(self) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        """Return the means of top, bottom and period [s], in this order, shape (3,), and the covariance of
        these means, shape (3, 3).

        The means are correlated: an event that starts high ends low and late. So are successive events,
        because a period belongs to two events.
        """
        n = self.period.size
        means = np.array([np.mean(a) for a in (self.top, self.bottom, self.period)])
        return means, covariance_of_mean(np.stack([self.top[:n], self.bottom[:n], self.period], axis=1))


def slip_events(recording: xr.Dataset, rig: PulledRig, channel: str = "force_ratio") -> Events:
    """Return the stick-slip events in a recording of the spring force over the weight.

    A median filter over an eighth of a natural period removes impulsive noise. An event is a fall of more
    than 8 % of the mean force that also exceeds the range of the filtered white noise. Tops closer than half
    a natural period count as one. With fewer than three tops the result has no events.

    Args:
        recording: over "time" [s], with the force over the weight.
        rig: set-up that pulls the slider.
        channel: name of the channel with the force over the weight.

    Raises:
        FitError: the recording has fewer than 16 samples in half a natural period; or the channel is missing,
            not finite or has a negative mean.
    """
    force = _force(recording, channel)
    time = recording["time"].values
    interval = float(np.median(np.diff(time)))
    half_period = math.pi / rig.natural_frequency
    free = 2.0 * half_period
    if half_period < 16 * interval:
        raise FitError(
            f"{channel} is sampled every {interval:g} s, too coarse for slips that last {half_period:g} s"
        )
    size = int(half_period / interval / 4) | 1
    smooth = scipy.ndimage.median_filter(force, size=size, mode="nearest")
    least = max(_EVENT * float(np.mean(force)), _range_of_noise(force, size))
    tops, _ = scipy.signal.find_peaks(smooth, prominence=least, distance=int(half_period / interval))
    if tops.size < 3:
        nothing = np.empty(0)
        return Events(nothing, nothing, nothing, 0.0, free)
    bottoms = np.array([a + np.argmin(smooth[a:b]) for a, b in pairwise(tops)])
    # Times are read on the steep falling flank, because noise shifts a top of the slow climb.
    fallen = [_fallen(time[a : b + 1], smooth[a : b + 1]) for a, b in zip(tops, bottoms, strict=False)]
    # A sticking slider needs the time `climb` for the rise of the force from the bottom to the next top; a
    # moving slider takes longer.
    climb = (smooth[tops[1:]] - smooth[bottoms]) / rig.loading_rate
    sticking = float(np.sum(np.minimum(climb, time[tops[1:]] - time[bottoms])) / np.ptp(time[tops]))
    return Events(smooth[tops[:-1]], smooth[bottoms], np.diff(fallen), sticking, free)


def _force(recording: xr.Dataset, channel: str) -> NDArray[np.float64]:
    """Return the values of the channel, shape (n,).

    Raises:
        FitError: the channel is missing, not finite, or has a negative mean.
    """
    if channel not in recording:
        raise FitError(f"the recording has no channel {channel!r}; it has {', '.join(map(str, recording))}")
    force = np.asarray(recording[channel].values, dtype=float)
    unit = recording[channel].attrs.get("units") or "1"
    bad = np.flatnonzero(~np.isfinite(force))
    if bad.size:
        raise FitError(
            f"{channel} [{unit}] is not finite in {bad.size} samples, from sample {bad[0]} on: take a part "
            "without them"
        )
    if np.mean(force) < 0.0:
        raise FitError(
            f"{channel} [{unit}] has a negative mean, {np.mean(force):.3g}: the force of a pulling spring is "
            "positive; change the sign of the channel, or take off its offset"
        )
    return force


def _range_of_noise(force: NDArray[np.float64], size: int) -> float:
    """Return the expected range (largest less smallest) of the white noise of a force [n], in its unit, after
    a median filter of `size` samples."""
    # A median of n samples scatters 1.2533 times (the root of pi/2) as much as their mean.
    spread = 1.2533 * noise_level(force) / math.sqrt(size) if size > 1 else noise_level(force)
    return 2.0 * math.sqrt(2.0 * math.log(force.size)) * spread


def _fallen(time: NDArray[np.float64], force: NDArray[np.float64]) -> float:
    """Return the last time [s] at which a falling force [n] is half-way between its first and last value,
    interpolated between the samples at `time` [n], s."""
    above = force - 0.5 * (force[0] + force[-1])
    i = int(np.flatnonzero(above >= 0.0)[-1])
    return float(time[i] + (time[i + 1] - time[i]) * above[i] / (above[i] - above[i + 1]))


def slider(rig: PulledRig, static: float, dynamic: float, damping: float = 0.0) -> PulledSlider:
    """Return the model of the pulled slider.

    Args:
        rig: mass and stiffness of the set-up.
        static, dynamic: friction coefficients, whose products with the weight are stiction and Coulomb force.
        damping: viscous damping by air and spring, N s/m.
    """
    law = StictionCoulombViscous(dynamic * rig.weight, static * rig.weight, damping)
    return PulledSlider(rig.mass, rig.stiffness, 0.0, law)


def simulated_force(model: PulledSlider, rig: PulledRig, interval: float | None = None) -> xr.Dataset:
    """Return a simulated recording of the stationary motion, over at least ten events, if the model of
    `slider` is pulled at the speed of the rig.

    The recording contains the spring force over the weight, `force_ratio`. Its attribute `period` [s] is the
    longest time that an event can take. Samples are `interval` [s] apart; by default at least 200 in an event
    and 64 in a slip.
    """
    law = model.friction
    rise = 2.0 * (law.stiction_force - law.coulomb_force) / (rig.stiffness * rig.speed)
    period = rise + 2.0 * math.pi / rig.natural_frequency
    start = law.stiction_force / (rig.stiffness * rig.speed)
    duration = start + 2 * _EVENTS * period
    rate = 1.0 / interval if interval else max(200.0 / period, 64.0 * rig.natural_frequency / math.pi)
    found = simulate(model, Ramp(rate=rig.speed, unit="m"), duration, sample_rate=rate)
    late = found.sel(time=slice(start + _EVENTS * period, None))
    return late.assign(force_ratio=late["spring_force"] / rig.weight).assign_attrs(period=period)


def identify_pulled_slider(
    recording: xr.Dataset,
    rig: PulledRig,
    channel: str = "force_ratio",
    *,
    tied: Mapping[str, str] | None = None,
) -> Fit:
    """Fit static and dynamic friction coefficients to the events of one recording.

    The fit compares the mean top, bottom and period of the events with those of a simulated `slider`, sampled
    like the recording, and weights them by the covariance of the means (see `Events.summary`). The shift of
    the means by noise is estimated on the simulated events and removed.

    Events do not distinguish damping from friction: a slip with a damping ratio zeta ends higher by exp(-pi
    zeta), but counts as undamped, so the excess is found low by about pi/2 zeta of itself (8 % at 0.05). The
    middle of top and bottom rises with the bottom. So the dynamic coefficient is found high, by about pi/2
    zeta of the excess (2.5 % of itself at 0.05, where the excess is a third of it). The intervals contain
    neither error.

    Args:
        recording: over "time" [s], with the spring force over the slider's weight.
        rig: mass, spring and speed of the set-up.
        channel: name of the channel with the force over the weight.
        tied: expression of one coefficient by the other, as for `identify_friction`:
            ``{"stiction_excess": "0.2 * dynamic_coefficient"}``.

    Returns:
        A fit of dynamic_coefficient and stiction_excess, the static minus the dynamic coefficient. It has no
        `predict` and no `model`; `slider` makes one from the coefficients.

    Raises:
        QuantityError: an expression in `tied` is wrong.
        RecordingError: the force has the wrong size for this spring.
        FitError: see `slip_events`; or there are fewer than ten times between events.
    """
    events = slip_events(recording, rig, channel)
    if events.period.size < _LEAST:
        raise FitError(f"only {events.period.size} stick-slip events: at least {_LEAST} are needed")
    means, covariance = events.summary()
    refuse_loading(means[0] - means[1], rig.loading_rate * means[2], f"{channel} of the recording")
    covariance *= (reach(0.95, degrees_of_freedom(events.period.size)) / reach(0.95)) ** 2
    interval = float(np.median(np.diff(recording["time"].values)))
    noise = noise_level(recording[channel].values)
    middle, half = 0.5 * (means[0] + means[1]), 0.5 * (means[0] - means[1])
    parameters = with_ties(
        (
            Parameter("dynamic_coefficient", middle, 0.2 * middle, 3.0 * middle, limits=(0.0, np.inf)),
            Parameter("stiction_excess", half, 0.05 * half, 10.0 * half, limits=(0.0, np.inf)),
        ),
        tied,
    )

    def force(values: Mapping[str, float]) -> xr.Dataset:
        dynamic = values["dynamic_coefficient"]
        return simulated_force(slider(rig, dynamic + values["stiction_excess"], dynamic), rig, interval)

    def fit(noise_free: NDArray[np.floating], covariance: NDArray[np.floating]) -> Fit:
        factor = np.linalg.cholesky(covariance)

        def residuals(values: dict[str, float]) -> NDArray[np.floating]:
            found = slip_events(force(values), rig)
            if found.period.size == 0:
                raise ValueError("no stick-slip")
            return scipy.linalg.solve_triangular(factor, found.summary()[0] - noise_free, lower=True)

        white = scipy.linalg.solve_triangular(factor, noise_free, lower=True)
        data = Residuals(residuals, white, 1.0, "mean top, bottom and period of the events")
        return fit_least_squares([data], parameters, noise_known=True, difference_step=1e-3, tolerance=1e-6)

    repeats = math.ceil(_NOISY * events.period.size / _EVENTS)
    found = fit(means, np.diag(np.diag(covariance)))
    clean = force(found.values)
    # The sampled events of the simulation scatter, too; the covariance of their means is added.
    covariance = covariance + slip_events(clean, rig).summary()[1]
    found = fit(means - _shift(clean, rig, noise, repeats), covariance)
    return replace(found, unpredicted=UNPREDICTED)


def _shift(clean: xr.Dataset, rig: PulledRig, noise: float, repeats: int) -> NDArray[np.floating]:
    """Return the shifts of the mean top, bottom and period [s] of events by white noise, in this order, shape
    (3,); 0 if no repetition shows events.

    Args:
        clean: simulated recording without noise, with `force_ratio`.
        rig: set-up that pulls the slider.
        noise: standard deviation of the force over the weight.
        repeats: number of random repetitions.
    """
    rng, true = np.random.default_rng(0), slip_events(clean, rig).summary()[0]
    shifts = []
    for _ in range(repeats):
        noisy = clean["force_ratio"] + noise * rng.standard_normal(clean.sizes["time"])
        found = slip_events(clean.assign(force_ratio=noisy), rig)
        if found.period.size:
            shifts.append(found.summary()[0] - true)
    return np.mean(shifts, axis=0) if shifts else np.zeros(3)
