r"""Expected covariance of a fit to planned recordings.

Recording k has the Jacobian :math:`J_k` by the fit's coordinates (including delay and offset of the position
channel), and noise with covariance :math:`\Sigma_k`. Near the truth, a least-squares fit has the covariance
:math:`A^{-1} B A^{-1}` with :math:`A = \sum_k J_k^T J_k` and :math:`B = \sum_k J_k^T \Sigma_k J_k`; for white
noise of equal level it is :math:`\sigma^2 A^{-1}`. All recordings have equal weights, as in the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimate.coloured import Coloured, scores
from ..estimate.parameter import Parameter
from ..estimate.tied import Ties
from ..identify.free import value_of
from ..identify.walk.experiments import PlannedWalk
from ..identify.walk.position_channel import CHANNEL
from ..physics.actuator import Actuator
from ..recording.chain import Chain

# Duration of the rest before the drive starts, s. A recording's position is measured from the mean position
# during this rest (its zero).
BEFORE = 0.1
# Largest eigenvalue, relative to the largest one of the matrix, that counts as rounding: the recordings do
# not identify that combination of coordinates. The matrix is A of the module, scaled to a diagonal of 1.
NOTHING = 1e-13
# Smallest change of the position, relative to its range, that is no rounding error, if a parameter changes by
# its own value. The derivative by a parameter with a smaller effect is set to 0.
ROUNDING = 1e-6

Array = NDArray[np.float64]


class FitSpace(NamedTuple):
    """Coordinates of a planned fit: its free `parameters`, including those of the position channel ("delay",
    "offset"), and `ties`, the values that follow from free parameters."""

    parameters: tuple[Parameter, ...]
    ties: Ties

    @property
    def names(self) -> list[str]:
        """Return the names of the parameters, in the order of the coordinates."""
        return [p.name for p in self.parameters]

    @property
    def own(self) -> NDArray[np.bool_]:
        """Return a mask [k]: True for parameters of the actuator, False for those of the position channel."""
        return np.array([name not in CHANNEL for name in self.names])


class Seen(NamedTuple):
    """Information in recordings on the coordinates of a fit.

    Fields: `normal` and `spread`, the matrices A and B of the module, [..., k, k] for k coordinates; total
    `duration` [...], s; and `low` and `high`, the least and greatest position of the end-effector [...], m,
    or rad for a rotary actuator. Leading axes are draws of the parameters and candidates.
    """

    normal: Array
    spread: Array
    duration: Array
    low: Array
    high: Array

    def plus(self, other: Seen) -> Seen:
        """Return the information of both sets of recordings together: matrices and durations are added, and
        the range of positions covers both."""
        return Seen(
            self.normal + other.normal,
            self.spread + other.spread,
            self.duration + other.duration,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )

    def times(self, share: float) -> Seen:
        """Return the information of the recordings repeated `share` times, perhaps a fraction: matrices and
        duration are multiplied by it."""
        return self._replace(
            normal=share * self.normal, spread=share * self.spread, duration=share * self.duration
        )

    def at(self, index: int | slice | tuple[slice, int]) -> Seen:
        """Return the information that an `index` selects along the leading axes (draws, candidates) of all
        arrays."""
        return Seen(*(one[index] for one in self))


def stacked(several: Sequence[Seen], axis: int = 0) -> Seen:
    """Return the information of several recordings as one record: their arrays, of equal shape, are stacked
    along the new axis number `axis` and not added."""
    return Seen(*(np.stack([one[i] for one in several], axis) for i in range(len(Seen._fields))))


def seen(
    model: Actuator, walk: PlannedWalk, name: str, space: FitSpace, chain: Chain, noise: Coloured | None
) -> Seen:
    """Return the information in a planned recording on the coordinates of a fit, at the values of a model.

    The arrays of the result have no leading axes; a recording counts once for each of its repetitions.

    Args:
        model: the actuator.
        walk: the recording.
        name: name of the recording in errors.
        space: coordinates of the fit, and values tied to them.
        chain: delay and scale of the position channel, and whether a recording is `zeroed`, which adds the
            error of its zero.
        noise: noise of the samples with its spectrum; None: white, with the standard deviation in `walk`.

    Raises:
        ArithmeticError: the motion cannot be simulated.
    """
    own = [n for n in space.ties.varying if n not in CHANNEL]
    motion = walk.motion(model, name)
    by = motion.slopes(model, chain.delay, own)
    position = motion.position(model, chain.delay)
    sizes = [abs(value_of(model, n)[0]) or np.inf for n in own]
    moves = np.abs(by[:, :-1]).max(axis=0, initial=0.0) * sizes > ROUNDING * np.ptp(position)
    # A derivative that consists of rounding errors would count as information, so it is set to 0. The last
    # column, the derivative by the delay, is kept.
    by = by * np.append(moves, True)
    columns = dict(zip([*own, "delay"], by.T, strict=True)) | {"offset": np.ones(len(by)) / chain.scale}
    values = {p.name: p.start for p in (*space.parameters, *space.ties.beside) if not p.tied}
    j = space.ties.follow(columns, space.ties(values), space.names)
    j = chain.scale * j * [p.slope(p.start) for p in space.parameters]
    normal = walk.repeats * j.T @ j
    spread = walk.noise**2 * normal if noise is None else walk.repeats * scores([j], noise)
    # The position of each recording is shifted by the error of its own zero, while a fit has a single offset
    # for all recordings.
    if chain.zeroed:
        moved = j.sum(axis=0)
        spread = spread + walk.repeats * zero_variance(walk, noise) * np.outer(moved, moved)
    return Seen(
        normal,
        spread,
        np.array(walk.repeats * walk.duration),
        np.array(float(position.min())),
        np.array(float(position.max())),
    )


def zero_variance(walk: PlannedWalk, noise: Coloured | None) -> float:
    """Return the variance of a recording's zero, m^2 (rad^2 for a rotary actuator).

    The zero is the mean of the samples in the rest of `BEFORE` seconds before the drive. `noise` is the noise
    of the samples with its spectrum and drift; None: white, with the standard deviation in `walk`.
    """
    n = BEFORE * walk.sample_rate
    if noise is None:
        return walk.noise**2 / n
    stationary = noise.autocovariance[0] + 2.0 * float(noise.autocovariance[1:].sum())
    return max(stationary, 0.0) / n + noise.walk * n / 3.0


class _Directions(NamedTuple):
    """Eigensystem of the matrix A of the module, scaled to a diagonal of 1.

    Fields: `scale` [..., k, k], by which the entries of A were divided; eigenvalues `values` [..., k] and
    eigenvectors `vectors` [..., k, k] (columns); and `null` [..., k], a mask of the eigenvectors that the
    recordings do not identify (see `NOTHING`).
    """

    scale: Array
    values: Array
    vectors: Array
    null: NDArray[np.bool_]


def _directions(of: Seen) -> _Directions:
    scale = np.sqrt(np.diagonal(of.normal, axis1=-2, axis2=-1))
    safe = np.where(scale > 0.0, scale, 1.0)
    outer = safe[..., :, None] * safe[..., None, :]
    values, vectors = np.linalg.eigh(of.normal / outer)
    return _Directions(outer, values, vectors, values <= NOTHING * values[..., -1:])


def untold(of: Seen) -> Array:
    """Return the number of linear combinations of coordinates that recordings do not identify, [...]: null
    eigenvalues of the scaled matrix A."""
    return np.count_nonzero(_directions(of).null, axis=-1).astype(float)


def covariance(of: Seen) -> Array:
    """Return the expected covariance of the fit's coordinates, [..., k, k] (see the module).

    A coordinate that the recordings do not identify has an infinite variance and covariances of 0.
    """
    scale, values, vectors, null = _directions(of)
    root = np.where(null, 0.0, 1.0 / np.where(null, 1.0, values))
    inverse = (vectors * root[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    found = inverse @ (of.spread / scale) @ inverse / scale
    lost = np.asarray(np.any((np.abs(vectors) > 1e-6) & null[..., None, :], axis=-1))
    either = np.logical_or(lost[..., :, None], lost[..., None, :])
    found = np.where(either, 0.0, 0.5 * (found + np.swapaxes(found, -1, -2)))
    k = found.shape[-1]
    found[..., np.arange(k), np.arange(k)] += np.where(lost, np.inf, 0.0)
    return found
