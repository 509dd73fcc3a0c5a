r"""Effect of a prior on a fit: two fits of the same recordings, without and with it.

In the coordinate q of a parameter (its logarithm, where it is searched for on that scale), with the estimate
and deviation without the prior q_a, σ_a, with it q, and those of the prior q_0, s:

.. math:: \mathrm{moved} = \frac{q - q_a}{\sigma_a}, \qquad
          \mathrm{off} = \frac{q_a - q_0}{\sqrt{s^2 + \sigma_a^2}}

`off` beyond ±1.96 means that recordings and prior disagree, at 5 % of all right priors. It is looked at
without the prior, for the fit with it lies where the prior says. Where the recordings leave a value open (σ_a
above s), little can disagree, and a wrong prior is not noticed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .parameter import Parameter
from .result import Fit

# Standard deviations beyond which recordings and prior disagree.
DISAGREES = 1.96


class PriorInfluence(NamedTuple):
    """Of one parameter: the `prior`'s value and deviation, the estimate `alone` (by the recordings) and
    `together`, in SI; `moved`, standard deviations of the estimate alone; `off`, see the module; `narrowed`,
    the width of the interval over that alone; `open`: alone, the recordings say less than the prior."""

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
        """Whether recordings and prior do."""
        return abs(self.off) > DISAGREES

    @property
    def sentence(self) -> str:
        """What the prior did, and that it is contradicted, if so."""
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
    """What the priors of a fit did to each of its parameters that has one.

    Args:
        alone: the fit of the same recordings without priors.
        together: with them.
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
    """Of a coordinate, by its interval of 95 %, which holds all minima; infinite where that has no end."""
    width = p.coordinate(ends[1]) - p.coordinate(ends[0])
    return width / (2.0 * DISAGREES) if math.isfinite(width) and width > 0.0 else math.inf
