r"""Likelihood of recordings for many simulated actuators at once, with delay and offset integrated out.

A recording contains the position with a delay and an offset. One simulation gives the residuals at a few
delays (nodes), and splines interpolate between these. So the sum of squares at any delay :math:`\delta` and
offset o is :math:`w^T M w + 2 o\, w^T s + n o^2`. M contains the scalar products of the residuals at each two
nodes, s their sums over the n samples, and :math:`w(\delta)` the weights of the spline. The integral over o
is a Gaussian integral in closed form; the integral over :math:`\delta` is a sum on a grid.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate.parameter import Parameter
from ...estimate.problem import FitError
from ...estimate.tied import Ties, names_in
from ...physics.actuator import Actuator
from ...simulation.ensemble import simulate_ensemble
from ...waveform.drive import Drive
from .displacement import MAX_STEPS, Displacement
from .position_channel import CHANNEL

# NODES: number of delays at which residuals are computed. REACH: range of delays on either side of the
# estimate, in standard errors. GRID: number of grid points in this range for the integral over the delay.
NODES, REACH, GRID = 7, 6.0, 301
# Largest number of simulated positions (members times samples) in memory at once.
LARGEST = 4_000_000

Array = NDArray[np.float64]


class Tabulated(NamedTuple):
    """A drive signal with a segment table that was computed once, because simulations of ensembles need the
    table repeatedly. Fields: the `table`, its `duration` [s], and the `unit` of the drive."""

    table: Drive
    duration: float
    unit: str = "V"

    def range(self) -> tuple[float, float]:
        """Return (0, 0) V, so that a range check passes: the drive was checked before."""
        return 0.0, 0.0

    def drive(self, duration: float) -> Drive:
        """Return the segment table, which is also valid for shorter durations."""
        return self.table


class Sums(NamedTuple):
    """Sums over the samples of all recordings, for members (simulations with different values) and nodes
    (tabulated delays). Residuals are simulated minus measured; NaN for members that cannot be simulated.

    Attributes:
        products: sums of the products of the residuals at each two nodes, m^2, shape (members, nodes, nodes).
        sums: sums of the residuals at each node, m, shape (members, nodes).
        size: number of samples.
    """

    products: Array
    sums: Array
    size: int

    def chi_squared(self, weights: Array, offset: Array) -> Array:
        """Return the sum of squared residuals, m^2, of each member, shape (members,).

        Args:
            weights: interpolation weights of each member's delay, shape (members, nodes).
            offset: offset of each member, added to its residuals, m, shape (members,).
        """
        quadratic = np.einsum("mk,mkl,ml->m", weights, self.products, weights)
        return quadratic + offset * (2.0 * np.sum(weights * self.sums, axis=1) + self.size * offset)


class SimulatedWalks:
    """Recordings of one actuator, to be simulated for many sets of its values (members).

    Attributes `nodes` and `grid` are the delays [s] at which residuals are computed, and over which the
    likelihood is summed.

    Args:
        motions, measured: simulation and measured positions [m] of each recording.
        model: the actuator whose values the members vary.
        delay: estimated delay, s, and its standard error, which is 0 if the delay is not free.
        ties: expressions of the tied values; None: no values are tied.

    Raises:
        FitError: delay or offset is tied, or another parameter is tied to one of them. They have no fixed
            value here, because they are integrated out.
    """

    def __init__(
        self,
        motions: Sequence[Displacement],
        measured: Sequence[Array],
        model: Actuator,
        delay: tuple[float, float],
        ties: Ties | None = None,
    ) -> None:
        self.ties = ties or Ties(())
        self.tied = [p for p in self.ties.beside if p.tied]
        for p in self.tied:
            for name in (p.name, *names_in(p.tied, p.name)):
                if name in CHANNEL:
                    raise FitError(f"{p.name} is tied to {p.tied!r}: a posterior has no ties of {name}")
        self.model, self.tolerance, self.measured = model, motions[0].tolerance, measured
        estimate, error = delay
        free = error > 0.0
        self.nodes = estimate + (np.linspace(-REACH, REACH, NODES) * error if free else np.zeros(1))
        self.grid = estimate + (np.linspace(-REACH, REACH, GRID) * error if free else np.zeros(1))
        self._read = []
        for motion in motions:
            # The motion starts at t = 0; at earlier times the position is that at rest.
            wanted = np.maximum(motion.time - self.nodes[:, None], 0.0)
            times, place = np.unique(np.append(0.0, wanted), return_inverse=True)
            drive: Any = Tabulated(motion.drive, float(times[-1]))
            self._read.append((drive, times, place[1:].reshape(wanted.shape)))

    def weights(self, delay: Array) -> Array:
        """Return the weights of the nodes that interpolate residuals at the given delays [s], shape (delays,
        nodes)."""
        if self.nodes.size == 1:
            return np.ones((delay.size, 1))
        return np.asarray(scipy.interpolate.make_interp_spline(self.nodes, np.eye(self.nodes.size))(delay))

    def __call__(self, own: Mapping[str, Array], count: int) -> Sums:
        """Simulate `count` members and return the sums of their residuals (simulated minus measured). `own`
        are the values of the actuator that differ between members: arrays [members] by name, SI."""
        k, size = self.nodes.size, sum(x.size for x in self.measured)
        found = Sums(np.zeros((count, k, k)), np.zeros((count, k)), size)
        columns = dict(own) or {"load": np.ones(count)}
        values = self.ties(own)
        columns |= {p.name: np.broadcast_to(values[p.name], count) for p in self.tied}
        for (drive, times, place), measured in zip(self._read, self.measured, strict=True):
            at_once = max(1, LARGEST // times.size)
            for start in range(0, count, at_once):
                part = slice(start, start + at_once)
                positions = simulate_ensemble(
                    self.model,
                    drive,
                    parameters={name: column[part] for name, column in columns.items()},
                    times=times,
                    tolerance=self.tolerance,
                    max_steps=MAX_STEPS,
                )["end_effector_position"].values
                r = positions[:, place] - measured
                found.products[part] += r @ r.transpose(0, 2, 1)
                found.sums[part] += r.sum(axis=2)
        return found


class Eliminated(NamedTuple):
    """Results for each member, of shape (members,): `log_likelihood`, the logarithm of the likelihood times
    the priors of delay and offset, integrated over both, up to a constant; and a random draw of `delay` [s]
    and `offset` [m] from their distribution."""

    log_likelihood: Array
    delay: Array
    offset: Array


def eliminated(
    members: SimulatedWalks,
    of: Sums,
    variance: float,
    known: Mapping[str, Parameter],
    random: np.random.Generator,
) -> Eliminated:
    """Integrate the likelihood over delay and offset, as far as they are free, and draw values of both;
    return the integrals and the draws for each member.

    Args:
        members: the simulated walks.
        of: sums over the residuals of the members.
        variance: variance of the noise, m^2.
        known: parameters "delay" and "offset" with their priors, as far as they are free.
        random: generator of the draws.
    """
    weights = members.weights(members.grid)
    log = -0.5 / variance * np.einsum("gk,mkl,gl->mg", weights, of.products, weights)
    log += log_prior(known.get("delay"), members.grid)
    offset = np.zeros_like(log)
    precision = np.inf
    if "offset" in known:
        prior = known["offset"].prior
        expected, spread = prior or (0.0, np.inf)
        precision = of.size / variance + 1.0 / spread**2
        offset = (expected / spread**2 - of.sums @ weights.T / variance) / precision
        log += 0.5 * precision * offset**2
    whole = np.asarray(scipy.special.logsumexp(log, axis=1))
    share = np.cumsum(np.exp(log - whole[:, None]), axis=1)
    cell = np.sum(share < random.random((len(log), 1)), axis=1).clip(max=members.grid.size - 1)
    width = members.grid[1] - members.grid[0] if members.grid.size > 1 else 0.0
    delay = members.grid[cell] + width * (random.random(cell.size) - 0.5)
    drawn = offset[np.arange(cell.size), cell] + random.standard_normal(cell.size) / np.sqrt(precision)
    return Eliminated(whole, delay, drawn)


def log_prior(p: Parameter | None, q: Array) -> Array | float:
    """Return the logarithm of a parameter's prior density at coordinates q, in the shape of q, up to a
    constant; 0 without a prior or for None (the parameter is not free)."""
    if p is None or p.prior is None:
        return 0.0
    mean, deviation = p.expected
    return -0.5 * ((q - mean) / deviation) ** 2
