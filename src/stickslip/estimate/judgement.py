"""Thresholds of the statements on a fit: lack of fit, and undetermined values."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ..quantities.records import Quantity, record


@record
class Judgement(NamedTuple):
    """Thresholds of the statements on a fit.

    ``fit.judgement`` contains the thresholds of a fit; ``fit.judged(false_alarm=0.001)`` returns the same fit
    with another threshold. The thresholds decide on lack of fit (`false_alarm`, `lack_ratio`), undetermined
    parameters (`wide_ratio`, `wide_share`, `indistinguishable`) and correlated residuals (`correlated`). The
    benchmarks "Detection of a wrong model" and "Coverage of the intervals" measure how often the statements
    are right.
    """

    false_alarm: Annotated[
        float,
        Quantity("", "α", "chance that a right model is said to lack something", above=0, maximum=0.5),
    ] = 0.005
    lack_ratio: Annotated[
        float, Quantity("", "q_l", "residual over noise below which a model lacks nothing", minimum=1)
    ] = 1.1
    wide_ratio: Annotated[
        float,
        Quantity("", "q_w", "upper over lower end of an interval that does not determine a value", above=1),
    ] = 10.0
    wide_share: Annotated[
        float,
        Quantity("", "r_w", "share of its range beyond which an interval is too wide", above=0, maximum=1),
    ] = 0.5
    indistinguishable: Annotated[
        float,
        Quantity("", "ρ_i", "correlation above which parameters are hard to tell apart", above=0, maximum=1),
    ] = 0.99
    correlated: Annotated[
        float,
        Quantity("", "ρ_r", "correlation of residuals above which they are not white", above=0, maximum=1),
    ] = 0.3


DEFAULT = Judgement()
