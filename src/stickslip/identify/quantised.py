"""Uncertainty of a fit from converter or encoder steps, or noise, of recorded quantities that it takes as
exact.

More samples do not average steps away, and noise of an input biases the fit. All samples at one converter
level have the same unknown error of up to half a step. So each level is moved at random by up to half a step
or, without steps, each sample by its noise. The effect on the fit, linearised, is added to its uncertainty.
The mean effect of all draws is a bias (noise adds small reversals to a motion, for example); it is added as a
standard error.
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

# DRAWS: number of random draws. WORTH_SAYING: share of a parameter's variance by steps or noise of the
# inputs, above which the fit gets a remark.
DRAWS, WORTH_SAYING = 24, 0.1
# Orders of the differences of samples from which noise is estimated; the smallest estimate counts. Higher
# orders remove smooth motion better if it is sampled coarsely.
ORDERS = (4, 6, 8)

Array = NDArray[np.float64]


class Inexact(NamedTuple):
    """A recorded quantity that a fit takes as exact: samples `values` [n], the `step` between converter
    levels (0: no levels), and the standard deviation of white `noise` (0: no noise), all in the same unit."""

    values: Array
    step: float = 0.0
    noise: float = 0.0

    @classmethod
    def seen(cls, values: Array, *, noisy: bool = True) -> Inexact:
        """Return the quantity with these samples and either the converter step or the white noise that they
        show, whichever is larger; with `noisy` False only the step."""
        step, noise = (
            converter_step(values),
            min(noise_level(values, order) for order in ORDERS) if noisy else 0.0,
        )
        return cls(values, 0.0, noise) if noise > step else cls(values, step)

    def drawn(self, random: np.random.Generator) -> Array:
        """Return copies of the samples moved at random, shape (draws, n): each level by up to half a step or,
        without steps, each sample by noise."""
        if self.step > 0.0:
            levels, place = np.unique(self.values, return_inverse=True)
            half = 0.5 * self.step
            return self.values + random.uniform(-half, half, (DRAWS, levels.size))[:, place]
        return self.values + self.noise * random.standard_normal((DRAWS, self.values.size))


def moved_by(known: Sequence[Inexact], residuals: Callable[[Sequence[Array]], Array]) -> Array | None:
    """Return the changes of a fit's residuals by random draws of the quantities, shape (draws, n); None if no
    quantity has a step or noise.

    Args:
        known: recorded quantities, usually one channel in each recording.
        residuals: function that takes the list of samples of all quantities and returns the residuals of all
            recordings, joined, shape (n,), in the unit of the data.
    """
    if not any(one.step or one.noise for one in known):
        return None
    random = np.random.default_rng(0)
    before = residuals([one.values for one in known])
    drawn = [one.drawn(random) for one in known]
    return np.stack([residuals(draw) - before for draw in zip(*drawn, strict=True)])


def with_moved(fit: Fit, moved: Array | None, said: str) -> Fit:
    """Return the fit with the uncertainty added that follows from the residual changes `moved`, shape (draws,
    n), from `moved_by`; unchanged if `moved` is None or the fit has no Jacobian. The remark `said` is added
    if this is more than `WORTH_SAYING` of the variance of any parameter."""
    if fit.jacobian is None or moved is None:
        return fit
    wider = with_inherited(fit, moved.T, np.eye(DRAWS) / DRAWS)
    with np.errstate(invalid="ignore"):
        share = 1.0 - np.diag(fit.uncertainty.covariance) / np.diag(wider.uncertainty.covariance)
    return replace(wider, remarks=(*fit.remarks, said)) if np.any(share > WORTH_SAYING) else wider


def said_steps(what: str, known: Sequence[Inexact], unit: str) -> str:
    """Return the sentence that the intervals allow for the steps or noise of a recorded or simulated
    quantity.

    Args:
        what: name of the quantity in the sentence.
        known: samples of the quantity in each recording; the largest step is named or, without steps, the
            largest noise.
        unit: unit of the quantity.
    """
    step, noise = (max(getattr(one, name) for one in known) for name in ("step", "noise"))
    if step == LEAST_STEP:
        return f"{what} is simulated to within {with_prefix(SIMULATED, unit, 3)}; the intervals allow for it"
    if step > 0.0:
        return f"{what} stands at steps of {with_prefix(step, unit, 3)}; the intervals allow for it"
    return f"{what} has a noise of {with_prefix(noise, unit, 3)}; the intervals allow for it"
