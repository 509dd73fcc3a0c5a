"""Random draws of a model's parameters from a fit, from a posterior, or from given samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..estimate.posterior import Posterior
from ..estimate.result import Fit
from ..physics.actuator import Actuator
from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError, array_si, unit_for
from ..simulation.varied import RATIOS, changed_fields, free_names, quantity_of

Array = NDArray[np.float64]

# Values in samples and fits that belong to the sensor or the sampler, not to the actuator: names and SI
# units.
NOT_OF_ACTUATOR = {"delay": "s", "offset": "m", "log_posterior": ""}
# Largest relative difference between a value of the model and the fit's estimate at which both count as
# equal.
SAME = 1e-6


def drawn_parameters(
    source: Fit | Posterior | Mapping[str, ArrayLike], model: Actuator, count: int, seed: int
) -> dict[str, Array]:
    """Return random draws of an actuator's parameters, arrays [count] in SI by name.

    Draws from a fit are normally distributed in the fit's coordinates (such as logarithms); draws beyond a
    bound are set to the bound, and parameters that lie at a bound are fixed. Draws from a posterior, or from
    arrays by name, are samples chosen at random with repetition; if there are just `count` samples, each is
    used once, in order. All parameters of a draw come from the same sample.

    Args:
        source: a fit, a posterior, or samples by name: arrays of equal length, in SI or with units.
        model: the actuator; values that are no parameters of the actuator are left out.
        count: number of draws.
        seed: seed of the random numbers.

    Raises:
        QuantityError: the source is of another type or contains no parameter of the model; arrays have an
            unknown name, different lengths or a wrong unit; a fit does not determine a parameter; or the
            model has other values than the fit.
    """
    random = np.random.default_rng(seed)
    if isinstance(source, Posterior):
        drawn = _sampled(source, count, random)
    elif isinstance(source, Fit):
        drawn = _normal(source, count, random)
    elif isinstance(source, Mapping):
        drawn = _rows(_arrays(source, model), count, random)
    else:
        raise QuantityError(f"fit is a Fit, a Posterior or arrays by name, not a {type(source).__name__}")
    known = free_names(model)
    kept = {name: np.broadcast_to(values, count) for name, values in drawn.items() if name in known}
    if not kept:
        raise QuantityError(
            f"the fit is of {', '.join(drawn) or 'nothing'}, none of which the model has: {', '.join(known)}"
        )
    if isinstance(source, Fit):
        _refuse_others(model, {name: source.values[name] for name in kept})
    return {name: np.array(values, dtype=float) for name, values in kept.items()}


def _arrays(source: Mapping[str, ArrayLike], model: Actuator) -> dict[str, Array]:
    """Convert given samples to SI; return arrays [n] by name.

    Raises QuantityError for a name that is neither a parameter of the model nor in `NOT_OF_ACTUATOR`, and for
    a wrong unit.
    """
    known, found = [*free_names(model), *NOT_OF_ACTUATOR], {}
    for name, one in source.items():
        if name not in known:
            raise QuantityError(f"draws of {name!r}{did_you_mean(name, known)}: there are {', '.join(known)}")
        found[name] = draws_in_si(model, name, one)
    return found


def draws_in_si(model: Actuator, name: str, values: ArrayLike) -> Array:
    """Return samples [n] of one parameter in SI.

    Args:
        model: the actuator, which gives the unit (m or rad).
        name: name of a parameter of the model, or one of `NOT_OF_ACTUATOR`.
        values: numbers in SI, or values with units.

    Raises:
        QuantityError: a unit is wrong.
    """
    quantity = quantity_of(model, None, name)
    unit = quantity.unit if quantity else unit_for(model, NOT_OF_ACTUATOR.get(name, ""))
    return np.ravel(array_si(values, unit, f"draws of {name}"))


def _sampled(source: Posterior, count: int, random: np.random.Generator) -> dict[str, Array]:
    columns = {str(n): v.values.ravel() for n, v in source.samples.items() if n != "log_posterior"}
    return _rows(columns, count, random)


def _rows(columns: Mapping[str, Array], count: int, random: np.random.Generator) -> dict[str, Array]:
    sizes = {values.size for values in columns.values()}
    if len(sizes) != 1 or 0 in sizes:
        raise QuantityError(f"draws of {', '.join(columns) or 'nothing'} must be as many of each, and some")
    size = sizes.pop()
    # If there are as many samples as draws, each sample is used once; otherwise a random choice with
    # repetition.
    chosen = np.arange(count) if size == count else random.integers(0, size, count)
    return {name: values[chosen] for name, values in columns.items()}


def _normal(fit: Fit, count: int, random: np.random.Generator) -> dict[str, Array]:
    covariance, bounded = fit.uncertainty.covariance, fit.uncertainty.bounded
    free = np.flatnonzero(bounded == 0)
    spread = covariance[np.ix_(free, free)]
    if not np.all(np.isfinite(spread)):
        names = [fit.parameters[i].name for i in free if not math.isfinite(covariance[i, i])]
        raise QuantityError(f"the data do not determine {', '.join(names)}: the step could be anything")
    centre = fit.coordinates if fit.uncertainty.centre is None else fit.uncertainty.centre
    at = np.tile(np.where(bounded == 0, centre, fit.coordinates), (count, 1))
    if free.size:
        at[:, free] += random.multivariate_normal(np.zeros(free.size), spread, count, method="eigh")
    values: dict[str, Any] = dict(fit.values)
    for i, p in enumerate(fit.parameters):
        values[p.name] = np.clip(p.values(at[:, i]), p.lower, p.upper)
    return {name: np.asarray(value, dtype=float) for name, value in fit.ties(values).items()}


def _refuse_others(model: Actuator, values: dict[str, float]) -> None:
    """Raise QuantityError if a value of the model differs from the fit's estimate in `values` (SI, by name).

    The largest allowed relative difference is `SAME`. Draws around another estimate would be of another
    model.
    """
    law, own = changed_fields(model, values)
    now = model.friction._asdict() | {name: getattr(model, name) for name in own}
    for name, value in (law | own).items():
        if not np.allclose(np.asarray(value, float), np.asarray(now[name], float), rtol=SAME, atol=0.0):
            given = [n for n in values if n not in RATIOS]
            raise QuantityError(
                f"the model has {name} = {now[name]!r} and the fit {value!r}: take the model of the fit, "
                f"with {', '.join(given)} as it found them (fit.model)"
            )
