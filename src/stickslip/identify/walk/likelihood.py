r"""Likelihood of recordings for many simulated actuators at once, with delay and offset integrated out.

A recording shows the position with a delay and an offset. Residuals at a few delays come from one simulation
and are interpolated by splines. So the sum of squares at any delay :math:`\delta` and offset o is :math:`w^T
M w + 2 o\, w^T s + n o^2`, with the products M and the sums s of residuals at those delays and the spline's
weights :math:`w(\delta)`. The integral over o is that of a normal distribution; the one over :math:`\delta`
is summed on a grid.
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

# Number of delays at which residuals are known, range of the grid in standard errors on either side of the
# estimate, and number of its points.
NODES, REACH, GRID = 7, 6.0, 301
# Largest number of positions in memory at once.
LARGEST = 4_000_000

Array = NDArray[np.float64]


class Tabulated(NamedTuple):
    """A drive with its segment table computed once, because ensembles ask for it repeatedly."""

    table: Drive
    duration: float
    unit: str = "V"

    def range(self) -> tuple[float, float]:
        """Return an empty range: the drive was checked before."""
        return 0.0, 0.0

    def drive(self, duration: float) -> Drive:
        """Return the segment table, which is also valid for shorter durations."""
        return self.table


class Sums(NamedTuple):
    """Sums over the residuals of members (simulations with different values) at the nodes (tabulated delays).

    Fields: products of each two nodes [members, nodes, nodes] and sums [members, nodes], over `size` samples;
    NaN for members that cannot be simulated.
    """

    products: Array
    sums: Array
    size: int

    def chi_squared(self, weights: Array, offset: Array) -> Array:
        """Return the sum of squares, m^2, of each member at its delay (weights [members, nodes]) and its
        offset [m]."""
        quadratic = np.einsum("mk,mkl,ml->m", weights, self.products, weights)
        return quadratic + offset * (2.0 * np.sum(weights * self.sums, axis=1) + self.size * offset)


class SimulatedWalks:
    """Recordings of one actuator, simulated for many sets of its values (members).

    Args:
        motions, measured: simulation and positions [m] of each recording.
        model: the actuator whose values the members vary.
        delay: estimated delay, s, and its standard error, which is 0 if the delay is not free.
        ties: expressions of the tied values.

    Raises:
        FitError: delay or offset are tied, or others are tied to them; they are integrated out.
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
            # Before the drive starts, the position is the position at rest.
            wanted = np.maximum(motion.time - self.nodes[:, None], 0.0)
            times, place = np.unique(np.append(0.0, wanted), return_inverse=True)
            drive: Any = Tabulated(motion.drive, float(times[-1]))
            self._read.append((drive, times, place[1:].reshape(wanted.shape)))

    def weights(self, delay: Array) -> Array:
        """Return the interpolation weights of the nodes at delays [s], shape (points, nodes)."""
        if self.nodes.size == 1:
            return np.ones((delay.size, 1))
        return np.asarray(scipy.interpolate.make_interp_spline(self.nodes, np.eye(self.nodes.size))(delay))

    def __call__(self, own: Mapping[str, Array], count: int) -> Sums:
        """Return the sums of `count` members with these values of the actuator, arrays [members] by name."""
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
    """Logarithm of the likelihood without delay and offset [members], and a random draw of both for each
    member."""

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
    """Integrate the likelihood over delay and offset, as far as they are free, and draw values of both.

    Args:
        members: the simulated walks; of: their sums of products with the recordings.
        variance: of the noise, m^2.
        known: the free ones of "delay" and "offset", with their priors.
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
    """Return the log prior at coordinates, up to a constant."""
    if p is None or p.prior is None:
        return 0.0
    mean, deviation = p.expected
    return -0.5 * ((q - mean) / deviation) ** 2
