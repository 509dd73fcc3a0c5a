r"""Effect of a prior on a fit, from two fits of the same recordings, without and with the prior.

Let q be the coordinate of a parameter (its logarithm on a logarithmic scale): q_a and σ_a are estimate and
standard deviation without the prior, q is the estimate with it, q_0 and s are mean and standard deviation of
the prior. Then

.. math:: \mathrm{moved} = \frac{q - q_a}{\sigma_a}, \qquad
          \mathrm{off} = \frac{q_a - q_0}{\sqrt{s^2 + \sigma_a^2}}

`off` beyond ±1.96 means that recordings and prior disagree; this happens for 5 % of correct priors. It uses
the fit without the prior, because the fit with it follows the prior. If the recordings determine a value less
well than the prior (σ_a above s), a wrong prior is not noticed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .parameter import Parameter
from .result import Fit

# Number of standard deviations beyond which recordings and prior disagree (95 % of correct priors are
# within).
DISAGREES = 1.96


class PriorInfluence(NamedTuple):
    """Effect of a prior on the estimate of one parameter.

    Attributes:
        parameter: the parameter.
        prior: value and standard deviation of the prior, in SI.
        alone: estimate by the recordings alone, in SI.
        together: estimate with the prior, in SI.
        moved: estimate with the prior minus that without, in standard deviations of the latter.
        off: estimate without the prior minus the prior's value, in standard deviations of both together.
            These two are differences of the coordinate q, with sign.
        narrowed: width of the interval with the prior, divided by the width without it.
        open: True if the recordings alone determine the parameter less well than the prior, so that a wrong
            prior is not noticed.
    """

    parameter: Parameter
    prior: tuple[float, float]
    alone: float
    together: float
    moved: float
    off: float
    narrowed: float
    open: bool

    @property
    def disagrees(self) -> bool:
        """Return True if recordings and prior disagree: `off` is beyond ±1.96."""
        return abs(self.off) > DISAGREES

    @property
    def sentence(self) -> str:
        """Return a sentence on the effect of the prior, or on its disagreement with the recordings and what
        to do."""
        p, digits = self.parameter, 3
        expected = p.shown(self.prior[0], digits)
        if self.disagrees:
            return (
                f"{p.name}: recordings and prior disagree: {p.shown(self.alone, digits)} without it, "
                f"{abs(self.off):.1f} standard deviations off the {expected} of the prior; leave it out, or "
                "widen it"
            )
        moved = f"from {p.shown(self.alone, digits)} to {p.shown(self.together, digits)}"
        if self.open:
            return (
                f"{p.name}: the recordings say less than the prior, {expected}, which moved it {moved}: were "
                "the prior wrong, nothing would show it"
            )
        return (
            f"{p.name}: the prior, {expected}, moved it {moved} ({abs(self.moved):.2g} of its standard "
            f"errors), with an interval {self.narrowed:.2g} times as wide"
        )


def prior_influence(alone: Fit, together: Fit) -> tuple[PriorInfluence, ...]:
    """Return the effect of the prior on each parameter that has one and is in both fits, in the order of the
    parameters.

    Args:
        alone: fit of the same recordings without priors.
        together: fit with priors.
    """
    free, given = alone.confidence_intervals(), together.confidence_intervals()
    found = []
    for p in together.parameters:
        if p.prior is None or p.name not in free:
            continue
        value, deviation = p.prior
        expected, spread = p.coordinate(value), deviation / p.slope(value)
        q_alone, q = p.coordinate(alone.values[p.name]), p.coordinate(together.values[p.name])
        own, after = (_deviation(p, ends[p.name]) for ends in (free, given))
        found.append(
            PriorInfluence(
                parameter=p,
                prior=p.prior,
                alone=alone.values[p.name],
                together=together.values[p.name],
                moved=(q - q_alone) / own,
                off=(q_alone - expected) / math.hypot(spread, own),
                narrowed=after / own,
                open=own > spread,
            )
        )
    return tuple(found)


def _deviation(p: Parameter, ends: tuple[float, float]) -> float:
    """Return the standard deviation of the parameter p in its coordinate q, from the lower and upper end of
    its 95 % interval (SI); infinite if the interval is infinite or empty."""
    width = p.coordinate(ends[1]) - p.coordinate(ends[0])
    return width / (2.0 * DISAGREES) if math.isfinite(width) and width > 0.0 else math.inf
