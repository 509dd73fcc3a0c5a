r"""Creep as a sum of Kelvin-Voigt terms, each a first-order lag; evenly spread over decades they give the
logarithmic law.

.. math:: y = C \Bigl( h + \sum_k a_k x_k \Bigr), \qquad \tau_k \dot x_k = h - x_k

y is the free stroke, C the gain, and h [V] the output of the hysteresis; term k has the state x_k [V], the
share a_k and the time constant τ_k. After a step at t = 0, terms of equal share a that are d decades apart
creep nearly as :math:`1 + g \log_{10}(t/t_0)` between the first and the last time constant, with g = a/d:
0.01 to 0.02 for PZT stacks [pi2009]. See `PER_DECADE` for the deviation. A recording does not determine time
constants beyond its duration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine._abi import ffi
from ...engine.binding import contiguous, doubles, sized
from ...engine.library import library
from ...quantities import registry
from ...quantities.records import Quantity, record
from ...quantities.units import QuantityError, to_si

Array = NDArray[np.float64]

# Approximate number of terms per decade of time for logarithmic creep. With this number, the sum of the terms
# follows a straight line of slope g (see the module) over the logarithm of time within 0.0002 g far from the
# first and last time constant. Near them it deviates more: by 0.01 g from half a decade after the first to
# one decade before the last, by 0.11 g between the two.
PER_DECADE = 2
# Smallest number of terms of logarithmic creep; from fewer terms no spacing follows.
FEWEST = 2


@registry.piezos.add
@record
class Creep(NamedTuple):
    """Creep of the stroke over seconds to hours, as a sum of first-order lags; see the module.

    `time_constants` [s] ascend; `shares` are the final strokes of the terms, as fractions of the stroke
    without creep. `logarithmic` makes terms for the logarithmic law.
    """

    time_constants: Annotated[tuple[float, ...], Quantity("s", "τ_k", "time constant of each term", above=0)]
    shares: Annotated[tuple[float, ...], Quantity("", "a_k", "share of each term", minimum=0)]

    def _check(self) -> None:
        if len(self.time_constants) != len(self.shares) or not self.shares:
            raise QuantityError(
                f"Creep has {len(self.time_constants)} time_constants [s] and {len(self.shares)} shares: "
                "each term needs one of both"
            )
        if list(self.time_constants) != sorted(set(self.time_constants)):
            raise QuantityError(f"Creep.time_constants [s] must ascend: {list(self.time_constants)}")

    @classmethod
    def logarithmic(cls, per_decade: float, begin: float | str = 0.1, end: float | str = 100.0) -> Creep:
        """Return logarithmic creep from the time `begin` to the time `end`, s, that adds the fraction
        `per_decade` of the stroke in each decade of time. Raises QuantityError unless the times are positive,
        finite and ascending."""
        times = spread(to_si(begin, "s", "begin"), to_si(end, "s", "end"))
        share = to_si(per_decade, "", "per_decade") * distance(times)
        return cls(tuple(times.tolist()), (share,) * times.size)

    @property
    def per_decade(self) -> float:
        """Return the mean fraction of the stroke per decade of time, the argument of `logarithmic`. A single
        term counts for half a decade."""
        return sum(self.shares) / len(self.shares) / distance(self.time_constants)


def spread(begin: float, end: float) -> Array:
    """Return time constants [s], evenly spaced on a logarithmic axis between two times [s], about
    `PER_DECADE` in each decade. Raises QuantityError unless the times are positive, finite and
    ascending."""
    if not 0.0 < begin < end < math.inf:
        raise QuantityError(f"creep from {begin:g} s to {end:g} s is out of range: 0 s < begin < end, finite")
    count = max(FEWEST, round(PER_DECADE * float(np.log10(end / begin))))
    return begin * 10 ** ((np.arange(count) + 0.5) * np.log10(end / begin) / count)


def distance(times: Sequence[float] | Array) -> float:
    """Return the mean distance of ascending time constants [s] in decades; half a decade for a single one.

    Each term of the logarithmic law represents this span.
    """
    if len(times) < FEWEST:
        return 1.0 / PER_DECADE
    return float(np.log10(times[-1] / times[0])) / (len(times) - 1)


class Lags(NamedTuple):
    """Creep terms in the form that the functions of the engine take: time constants `tau` [lags], s."""

    tau: Array


def lag_change(tau, step, x, before, after):
    """Return the exact change of the state x of a first-order lag over a step in which its input changes
    linearly.

    Args:
        tau, step: time constant, and length of the step, s.
        x: state at the start of the step.
        before, after: input at the start and at the end of the step.
    """
    part = -math.expm1(-step / tau)
    return part * (before - x) + (after - before) * (1.0 - part * (tau / step))


def struct_of(tau: Array, shares: Array) -> Any:
    """Return creep terms as a C struct for the engine; the arrays must exist as long as the struct.

    Args:
        tau: time constants, s.
        shares: share of each term in the stroke.
    """
    sized("shares", shares, tau.size)
    return ffi.new("struct lags *", (tau.size, doubles(tau, "time constants"), doubles(shares, "shares")))


def relaxed(lags: Lags, times: Array, values: Array, x: Array, out: Array) -> None:
    """Compute the outputs of first-order lags of a signal, exactly.

    Args:
        lags: time constants of the lags.
        times: sample times, s.
        values: the signal at these times, linear between them.
        x: states of the lags at the start, [lags]; replaced by those at the end.
        out: array for the result, [samples, lags].
    """
    sized("x", x, lags.tau.size)
    sized("out", out, times.size * x.size)
    sized("values", values, times.size)
    arrays = contiguous(times), contiguous(values), doubles(x, "x", True), doubles(out, "out", True)
    library().stickslip_lags_relaxed(struct_of(lags.tau, lags.tau), times.size, *arrays)


def before_creep(lags: Lags, times: Array, values: Array, shares: Array, x: Array, out: Array) -> None:
    """Invert creep: compute the signal h whose sum with its creep, the lags of h times their shares, equals
    `values`.

    Args:
        lags: time constants of the lags.
        times: sample times, s.
        values: wanted sum at these times, V; h is linear between them.
        shares: share of each lag.
        x: states of the lags at the start, V, [lags]; replaced by those at the end.
        out: array for h at the sample times, V.
    """
    sized("x", x, lags.tau.size)
    sized("out", out, times.size)
    sized("values", values, times.size)
    arrays = contiguous(times), contiguous(values), doubles(x, "x", True), doubles(out, "out", True)
    library().stickslip_lags_undone(struct_of(lags.tau, shares), times.size, *arrays)
