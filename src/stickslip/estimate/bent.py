r"""Distributions along a curved minimum, used as proposals for a posterior that can be evaluated at points.

Each coordinate is a polynomial of second order of the previous coordinates plus a Student's t residual:

.. math:: z_k = p_k(z_1, \dots, z_{k-1}) + s_k e_k .

Such a map is triangular [parno2018]: its density is exact, because it changes volumes only by :math:`\prod
s_k`. Several of them, one for each minimum, make a mixture.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Degrees of freedom of Student's t, with which residuals are drawn. Its tails are heavier than those of a
# posterior under Gaussian noise.
FREEDOM = 7.0
# A proposal must be wider than the posterior. WIDER: factor on all fitted standard deviations of the
# residuals. FAR_SHARE: share of the drawn points whose residuals are multiplied by FAR in addition, for a
# posterior with a longer tail on one side.
WIDER, FAR_SHARE, FAR = 1.1, 0.15, 2.0
# HELD_BACK: weight, in number of points, of the ridge penalty that pulls the second-order coefficients to
# zero. FEWEST: effective number of weighted points above which a second-order polynomial is fitted; with
# fewer points, only a constant is fitted.
HELD_BACK, FEWEST = 3.0, 60.0
# Smallest share of a component that remains in a mixture.
LEAST_SHARE = 1e-3


class Bent(NamedTuple):
    """Component of a mixture: a distribution along a curved minimum.

    A point is ``centre + z @ axes``. Fields: `centre` [k]; `axes` as rows [k, k], which need not have length
    1; `coefficients`: for each coordinate z_i, those of its polynomial in the previous coordinates, in the
    order of `_terms` (a single constant is allowed); `left`: scales of the t residuals of z [k].
    """

    centre: Array
    axes: Array
    coefficients: tuple[Array, ...]
    left: Array

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Return `count` random points of the component, shape (count, k), drawn with the generator
        `random`."""
        k = self.centre.size
        t = random.standard_normal((count, k)) / np.sqrt(random.chisquare(FREEDOM, (count, 1)) / FREEDOM)
        t *= np.where(random.random((count, 1)) < FAR_SHARE, FAR, 1.0)
        z = np.zeros((count, k))
        for i, c in enumerate(self.coefficients):
            z[:, i] = _terms(z[:, :i], c.size) @ c + self.left[i] * t[:, i]
        return self.centre + z @ self.axes

    def log_density(self, points: Array) -> Array:
        """Return the natural logarithm of the component's normalised density at points [n, k], shape (n,)."""
        k, z = self.centre.size, _along(self.axes, points - self.centre)
        squared = np.zeros(len(points))
        for i, c in enumerate(self.coefficients):
            squared += ((z[:, i] - _terms(z[:, :i], c.size) @ c) / self.left[i]) ** 2
        level = (
            scipy.special.gammaln(0.5 * (FREEDOM + k))
            - scipy.special.gammaln(0.5 * FREEDOM)
            - 0.5 * k * np.log(FREEDOM * np.pi)
        )
        near, far = (
            np.log(share) - k * np.log(wide) - 0.5 * (FREEDOM + k) * np.log1p(squared / wide**2 / FREEDOM)
            for share, wide in ((1.0 - FAR_SHARE, 1.0), (FAR_SHARE, FAR))
        )
        return level - self.log_volume + np.logaddexp(near, far)

    @property
    def log_volume(self) -> float:
        """Return the natural logarithm of the component's volume: the product of the scales `left` of the
        residuals and the magnitude of the determinant of the axes."""
        return float(np.sum(np.log(self.left)) + np.linalg.slogdet(self.axes)[1])


class Mixture(NamedTuple):
    """Mixture of distributions: the components `parts` (each a `Bent`), and their `shares`, shape (parts,),
    whose sum is 1."""

    shares: Array
    parts: tuple[Bent, ...]

    def drawn(self, count: int, random: np.random.Generator) -> Array:
        """Return `count` random points of the mixture, shape (count, k), in random order, drawn with the
        generator `random`."""
        counts = random.multinomial(count, self.shares)
        points = [part.drawn(int(n), random) for part, n in zip(self.parts, counts, strict=True)]
        return random.permutation(np.concatenate(points))

    def log_parts(self, points: Array) -> Array:
        """Return the natural logarithm of each component's density multiplied by its share, at points [n, k];
        shape (parts, n)."""
        shares = np.log(self.shares)
        return np.array([s + part.log_density(points) for s, part in zip(shares, self.parts, strict=True)])

    def log_density(self, points: Array) -> Array:
        """Return the natural logarithm of the mixture's normalised density at points [n, k], shape (n,)."""
        return np.asarray(scipy.special.logsumexp(self.log_parts(points), axis=0))

    def fitted(self, points: Array, weights: Array) -> Mixture:
        """Return the mixture fitted again to points [n, k] with weights [n] whose sum is 1, by one step of
        expectation maximisation. Components with a share below `LEAST_SHARE` are dropped."""
        parts = self.log_parts(points)
        each = weights * np.exp(parts - np.asarray(scipy.special.logsumexp(parts, axis=0)))
        shares = each.sum(axis=1)
        kept = np.flatnonzero(shares > LEAST_SHARE)
        made = tuple(bent(points, each[i] / shares[i]) for i in kept)
        return Mixture(shares[kept] / shares[kept].sum(), made)


def straight(centres: Sequence[Array], covariances: Sequence[Array]) -> Mixture:
    """Return a mixture of t distributions without curvature and with equal shares, one about each centre [k];
    its axes are those of `_principal` for the covariance [k, k] with the same index."""
    parts = []
    for centre, covariance in zip(centres, covariances, strict=True):
        ones = np.ones(centre.size)
        parts.append(Bent(centre, _principal(covariance), tuple(0.0 * ones[:1] for _ in ones), ones))
    return Mixture(np.full(len(parts), 1.0 / len(parts)), tuple(parts))


def bent(points: Array, weights: Array) -> Bent:
    """Return a component fitted to points [n, k] with weights [n] whose sum is 1.

    The axes of the component are the coordinate axes or the principal axes (see `_principal`), whichever give
    the smaller volume.
    """
    away = points - weights @ points
    covariance = (away.T * weights) @ away
    own = np.diag(np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny)))
    found = [_in_axes(points, weights, axes) for axes in (own, _principal(covariance))]
    return min(found, key=lambda one: one.log_volume)


def _in_axes(points: Array, weights: Array, axes: Array) -> Bent:
    """Return a component along axes [k, k] (rows), fitted to points [n, k] with weights [n] whose sum is 1.

    The axes are reordered, because each coordinate may depend on the previous ones only: the last coordinate
    is the one with the smallest residual as a polynomial of all others, and so on down to the first.
    """
    centre = weights @ points
    z = _along(axes, points - centre)
    before, order = list(range(centre.size)), []
    while before:
        left_of = {i: _explained(z[:, [j for j in before if j != i]], z[:, i], weights)[1] for i in before}
        order.insert(0, min(before, key=left_of.__getitem__))
        before.remove(order[0])
    # Fit each coordinate again, now as a polynomial of the coordinates before it in the chosen order.
    found = [_explained(z[:, order[:n]], z[:, i], weights) for n, i in enumerate(order)]
    left = WIDER * np.array([rest for _, rest in found])
    return Bent(centre, axes[order], tuple(c for c, _ in found), left)


def _along(axes: Array, away: Array) -> Array:
    """Return the coordinates z [n, k] of points given as differences [n, k] from the centre, so that ``away =
    z @ axes``; the rows of `axes` are the axes."""
    return np.asarray(np.linalg.solve(axes.T, away.T).T, dtype=np.float64)


def _principal(covariance: Array) -> Array:
    """Return the principal axes of a covariance [k, k] in coordinates of unit variance, transformed back, as
    rows A [k, k] with A' A equal to the covariance; zero variances are replaced by tiny positive ones."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0.0, scale, np.finfo(float).tiny ** 0.5)
    variances, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    variances = np.maximum(variances, 1e-12 * max(float(variances.max(initial=0.0)), 1e-300))
    return np.asarray((vectors * np.sqrt(variances)).T * scale)


def _explained(others: Array, z: Array, weights: Array) -> tuple[Array, float]:
    """Fit a second-order polynomial of the coordinates `others` [n, i] to the coordinate z [n] of points with
    weights [n] whose sum is 1. Return its coefficients, and the standard deviation of its residual, increased
    for the number of coefficients."""
    effective, i = 1.0 / float(np.sum(weights**2)), others.shape[1]
    size = 1 + i + i * (i + 1) // 2 if effective > FEWEST else 1
    terms = _terms(others, size)
    held_back = np.where(np.arange(size) > i, HELD_BACK / effective, 1e-12)
    weighted = terms.T * weights
    c = np.asarray(np.linalg.solve(weighted @ terms + np.diag(held_back), weighted @ z), dtype=np.float64)
    rest = float(weights @ (z - terms @ c) ** 2) * (1.0 + size / effective)
    return c, float(np.sqrt(rest))


def _terms(z: Array, size: int) -> Array:
    """Return the first `size` terms of a second-order polynomial at points z [n, i], shape (n, size): 1, then
    each coordinate, then each product of two coordinates (squares included)."""
    columns = [np.ones(len(z)), *z.T]
    pairs = itertools.combinations_with_replacement(range(z.shape[1]), 2)
    columns += [z[:, a] * z[:, b] for a, b in pairs] if size > len(columns) else []
    return np.stack(columns[:size], axis=1)
