"""Starting point of a plan: the model, the free parameters of a fit, its noise, and other possible parameter
values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate import Fit
from ..estimate.coloured import Coloured, noise_of
from ..estimate.parameter import Parameter, Values
from ..estimate.posterior import Posterior
from ..estimate.tied import Ties
from ..identify.free import check_names, parameter, value_of
from ..identify.recorded.at_rest import SAME_RATE, noise_at_rest
from ..identify.walk.displacement import has_slopes
from ..identify.walk.position_channel import CHANNEL, OBSERVED
from ..identify.walk.walks import own_values
from ..physics.actuator import Actuator
from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError, coordinate_of, optional_si, unit_for
from ..recording.chain import Chain
from ..simulation.varied import free_names, with_values
from ..study.drawn import draws_in_si
from .information import FitSpace

# Sample rate of planned recordings, Hz, if neither the user nor a fit nor recorded noise gives one.
SAMPLE_RATE = 2e3
# DRAWS: default number of draws from the normal distribution of a fit. MOST_DRAWS: largest number of draws of
# the parameters that a plan uses, because candidates are simulated at each of them.
DRAWS, MOST_DRAWS = 8, 32

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """Starting point of a plan: actuator, coordinates of the planned fit, sampling and noise of the position.

    Fields: `model`; `space`, the coordinates of the fit; `chain` of the position channel; `sample_rate`, Hz;
    `noise`, standard deviation of a sample, m, or rad for a rotary actuator; and `colour`, the noise with its
    spectrum, or None if it is white.
    """

    model: Actuator
    space: FitSpace
    chain: Chain
    sample_rate: float
    noise: float
    colour: Coloured | None

    @property
    def free(self) -> list[str]:
        """Return the names of the free parameters of the actuator, without those of the position channel."""
        return [name for name in self.space.names if name not in CHANNEL]

    def at(self, values: Values) -> Start:
        """Return the starting point with other values of the actuator (by name, SI) in its model and its
        coordinates; delay and offset of the position channel are unchanged."""
        own = {name: x for name, x in values.items() if name not in CHANNEL}
        moved = tuple(_moved(p, own.get(p.name, p.start)) for p in self.space.parameters)
        every = self.space.ties({**{p.name: p.start for p in moved}, **own})
        return replace(
            self, model=with_values(self.model, own_values(every)), space=FitSpace(moved, self.space.ties)
        )


class _Noise(NamedTuple):
    level: float
    colour: Coloured | None
    rate: float


def start(
    source: Any,
    free: Sequence[str] | None,
    channel: Sequence[str],
    chain: Chain | None,
    sample_rate: float | None,
    noise: Any,
) -> Start:
    """Return the starting point of a plan. `source` is the argument `model` of `plan_experiment`, an actuator
    or a fit; the other arguments are as for `plan_experiment`.

    Raises:
        QuantityError: an argument does not fit; the message names it.
    """
    fit = source if isinstance(source, Fit) else None
    model = source if fit is None else fit.model
    if not isinstance(model, Actuator):
        what = f"a fit of {type(model).__name__}" if fit else f"{type(source).__name__}"
        raise QuantityError(f"an experiment is planned from an actuator or a fit of one, not from {what}")
    if fit is not None and fit.observed != OBSERVED:
        raise QuantityError(
            f"the fit is of {fit.observed}: an experiment is planned from a fit of {OBSERVED}"
        )
    if not has_slopes(model):
        law = type(model.friction).__name__
        raise QuantityError(
            f"{law} on {'a clamped' if model.clamped else 'this'} actuator has no derivatives to plan by: "
            "they are of an actuator that moves, with a law of one internal state"
        )
    if chain is None:
        chain = Chain(delay=fit.values.get("delay", 0.0)) if fit is not None else Chain()
    found = _noise(noise, sample_rate, fit, unit_for(model, "m"))
    return Start(
        model, _space(model, fit, free, channel, chain), chain, found.rate, found.level, found.colour
    )


def _space(
    model: Actuator, fit: Fit | None, free: Sequence[str] | None, channel: Sequence[str], chain: Chain
) -> FitSpace:
    known = {p.name: p for p in fit.parameters} if fit is not None else {}
    beside = fit.ties.beside if fit is not None else ()
    names = list(free) if free is not None and not isinstance(free, str) else free
    if names is None:
        if fit is None:
            raise QuantityError(
                f"free is missing: name what is to be determined, of {', '.join(free_names(model))}"
            )
        names = [name for name in known if name not in CHANNEL]
    check_names(names, free_names(model), {})
    for p in beside:
        if p.name in names:
            raise QuantityError(f"{p.name!r} is fixed or tied in the fit: it cannot be free in the plan")
    for name in channel:
        if name not in CHANNEL:
            hint = did_you_mean(name, CHANNEL)
            raise QuantityError(f"{name!r} is not of the position channel{hint}: it has {', '.join(CHANNEL)}")
    own = [_moved(known[n], fit.values[n]) if fit and n in known else _parameter(model, n) for n in names]
    zero = {"delay": (chain.delay, "s"), "offset": (chain.offset, unit_for(model, "m"))}
    more = [Parameter(n, zero[n][0], unit=zero[n][1], log=False) for n in dict.fromkeys(channel)]
    parameters = (*own, *more)
    others = [p for p in beside if p.tied or p.fixed]
    return FitSpace(parameters, Ties([*parameters, *others]))


def _parameter(model: Actuator, name: str) -> Parameter:
    """Return the fit parameter of a field of the model, by name, at the model's value.

    Its scale is logarithmic if the value is positive, otherwise linear. A plan does not search, so the
    parameter has no upper bound and no prior.
    """
    value, quantity = value_of(model, name)
    if quantity is None or value > 0.0:
        return _moved(parameter(model, name, {}, coordinate_of(model)), value)
    return Parameter(name, value, unit=unit_for(model, quantity.unit), log=False)


def _moved(p: Parameter, value: float) -> Parameter:
    least = 0.0 if p.log or p.square else -math.inf
    return p._replace(start=value, lower=least, upper=math.inf, prior=None)


def _noise(noise: Any, sample_rate: float | None, fit: Fit | None, unit: str) -> _Noise:
    if isinstance(noise, xr.Dataset):
        rest = noise_at_rest(noise, OBSERVED)
        rest.check(sample_rate or rest.rate, "sample_rate is")
        return _Noise(rest.level, rest.colour, rest.rate)
    level = optional_si(noise, unit, "noise")
    if level is not None:
        if not 0.0 < level < math.inf:
            raise QuantityError(f"noise = {level:g} {unit} is out of range: it must be > 0, and finite")
        return _Noise(level, None, sample_rate or _rate(fit) or SAMPLE_RATE)
    if fit is None:
        raise QuantityError(
            f"noise is missing: give the standard deviation of a sample of the position [{unit}], or a "
            f"recording of {OBSERVED} at rest"
        )
    rate = _rate(fit)
    if rate is None or (sample_rate is not None and abs(sample_rate / rate - 1.0) > SAME_RATE):
        return _Noise(fit.rmse, None, sample_rate or SAMPLE_RATE)
    return _Noise(fit.rmse, noise_of(fit), rate)


def _rate(fit: Fit | None) -> float | None:
    """Return the common sample rate of all recordings of a fit, Hz; None without a fit or if the rates
    differ."""
    if fit is None or not fit.times or not all(t.size > 1 for t in fit.times):
        return None
    rates = [(t.size - 1) / float(t[-1] - t[0]) for t in fit.times]
    return rates[0] if max(rates) <= min(rates) * (1.0 + SAME_RATE) else None


def draws_of(
    begin: Start, source: Any, draws: int | Posterior | Mapping[str, Any] | None, seed: int
) -> list[Start]:
    """Return starting points: first with the model's own values, then one for each draw of other values, at
    most `MOST_DRAWS` of them.

    Args:
        begin: starting point of the plan.
        source: actuator or fit from which the plan starts.
        draws: number of draws from the fit's normal distribution; a posterior; or arrays by name, of which
            evenly spaced rows are taken. None: `DRAWS` for a fit, no draws for an actuator.
        seed: seed of the draws from a fit.

    Raises:
        QuantityError: the draws belong to another model, their arrays differ in length or are empty, or a
            number of draws is given without a fit.
    """
    if draws is None:
        draws = DRAWS if isinstance(source, Fit) else 0
    if isinstance(draws, Posterior):
        some = draws.samples.drop_vars("log_posterior", errors="ignore")
        draws = {str(name): one.values.ravel() for name, one in some.data_vars.items()}
    if isinstance(draws, Mapping):
        values = _given(begin, draws)
    elif draws and isinstance(source, Fit):
        values = _drawn(source, int(draws), seed)
    elif draws:
        raise QuantityError(
            f"draws = {draws}: there is nothing to draw from but the model; give a fit, a posterior or "
            "values by name"
        )
    else:
        values = []
    return [begin, *(begin.at(one) for one in values)]


def _given(begin: Start, samples: Mapping[str, Any]) -> list[Values]:
    arrays = {name: draws_in_si(begin.model, name, one) for name, one in samples.items()}
    known = free_names(begin.model)
    for name in arrays:
        if name not in known and name not in CHANNEL:
            hint = did_you_mean(name, known)
            raise QuantityError(
                f"draws: there is no {name!r} in this actuator with {type(begin.model.friction).__name__}"
                f"{hint}: they are of another model"
            )
    sizes = {one.size for one in arrays.values()}
    if len(sizes) != 1 or 0 in sizes:
        raise QuantityError("draws: each parameter needs as many values as the others, and at least one")
    size = sizes.pop()
    some = np.linspace(0, size - 1, min(size, MOST_DRAWS)).round().astype(int)
    return [{name: float(one[i]) for name, one in arrays.items()} for i in some]


def _drawn(fit: Fit, count: int, seed: int) -> list[Values]:
    """Return `count` draws, at most `MOST_DRAWS`, from the normal distribution of a fit's coordinates:
    parameter values by name, SI, clipped at the fit's bounds. Coordinates without a finite variance keep the
    estimate. `seed` is that of the random numbers."""
    spread = fit.uncertainty.covariance
    sure = np.isfinite(np.diag(spread))
    random = np.random.default_rng(seed)
    q = np.tile(fit.coordinates, (min(count, MOST_DRAWS), 1))
    inner = spread[np.ix_(sure, sure)]
    q[:, sure] += random.multivariate_normal(np.zeros(len(inner)), inner, len(q), method="eigh")
    return [
        {
            p.name: float(np.clip(p.value(x), p.lower, p.upper))
            for p, x in zip(fit.parameters, row, strict=True)
        }
        for row in q
    ]
