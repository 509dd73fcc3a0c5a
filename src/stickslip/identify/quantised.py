"""Uncertainty from recorded quantities that a fit takes as exact: converter or encoder steps and noise.

More samples do not average steps away, and noise biases what follows from the quantity. Samples at a single
level only show that the quantity is within half a step of it. So each level is moved at random by up to half
a step, and each sample by as much noise as it has. The effect on the fit, linearised, is added to its
uncertainty. The common effect of all draws (such as small reversals that noise adds to a motion) is a bias;
it is added as a standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimate.coloured import with_inherited
from ..estimate.result import Fit
from ..quantities.units import with_prefix
from ..recording.noise import noise_level
from .recorded.known_noise import LEAST_STEP, SIMULATED
from .recorded.levels import converter_step

# Number of random draws of all levels, and the share of a variance above which the effect is reported.
DRAWS, WORTH_SAYING = 24, 0.1
# Orders of the differences that show noise: higher orders remove smooth motion better if samples are coarse.
ORDERS = (4, 6, 8)

Array = NDArray[np.float64]


class Inexact(NamedTuple):
    """A recorded quantity: samples [n], the `step` between their levels (0: none), and the standard deviation
    of their `noise`, in their unit."""

    values: Array
    step: float = 0.0
    noise: float = 0.0

    @classmethod
    def seen(cls, values: Array, *, noisy: bool = True) -> Inexact:
        """Return the quantity with the steps that its samples show or, if it may be `noisy` and has none,
        with their white noise."""
        step, noise = (
            converter_step(values),
            min(noise_level(values, order) for order in ORDERS) if noisy else 0.0,
        )
        return cls(values, 0.0, noise) if noise > step else cls(values, step)

    def drawn(self, random: np.random.Generator) -> Array:
        """Return samples moved at random by steps and noise, shape (draws, n)."""
        if self.step > 0.0:
            levels, place = np.unique(self.values, return_inverse=True)
            half = 0.5 * self.step
            return self.values + random.uniform(-half, half, (DRAWS, levels.size))[:, place]
        return self.values + self.noise * random.standard_normal((DRAWS, self.values.size))


def moved_by(known: Sequence[Inexact], residuals: Callable[[Sequence[Array]], Array]) -> Array | None:
    """Return the changes of all residuals of a fit, joined, for random draws of the quantities, shape (draws,
    n); None if all are exact. `residuals` computes them from other samples."""
    if not any(one.step or one.noise for one in known):
        return None
    random = np.random.default_rng(0)
    before = residuals([one.values for one in known])
    drawn = [one.drawn(random) for one in known]
    return np.stack([residuals(draw) - before for draw in zip(*drawn, strict=True)])


def with_moved(fit: Fit, moved: Array | None, said: str) -> Fit:
    """Return the fit with the uncertainty of the moved residuals added, and with the remark `said` if that is
    a large part."""
    if fit.jacobian is None or moved is None:
        return fit
    wider = with_inherited(fit, moved.T, np.eye(DRAWS) / DRAWS)
    with np.errstate(invalid="ignore"):
        share = 1.0 - np.diag(fit.uncertainty.covariance) / np.diag(wider.uncertainty.covariance)
    return replace(wider, remarks=(*fit.remarks, said)) if np.any(share > WORTH_SAYING) else wider


def said_steps(what: str, known: Sequence[Inexact], unit: str) -> str:
    """Return a sentence that the intervals allow for steps (of a converter or of simulations) or noise of a
    quantity."""
    step, noise = (max(getattr(one, name) for one in known) for name in ("step", "noise"))
    if step == LEAST_STEP:
        return f"{what} is simulated to within {with_prefix(SIMULATED, unit, 3)}; the intervals allow for it"
    if step > 0.0:
        return f"{what} stands at steps of {with_prefix(step, unit, 3)}; the intervals allow for it"
    return f"{what} has a noise of {with_prefix(noise, unit, 3)}; the intervals allow for it"
