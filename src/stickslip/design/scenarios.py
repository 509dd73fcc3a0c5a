"""Conditions under which a drive signal is judged: loads, detuning, and draws of uncertain parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..estimate.posterior import Posterior
from ..estimate.result import Fit
from ..physics.actuator import Actuator
from ..quantities.records import Quantity, did_you_mean, quantities_within
from ..quantities.units import QuantityError, to_si
from ..simulation.members import SCALES
from ..simulation.varied import free_names, value_of, with_values
from ..study.drawn import NOT_OF_ACTUATOR, draws_in_si

Array = NDArray[np.float64]
# Types that describe the uncertainty of an actuator: a posterior; a fit (its covariance); or arrays of draws
# by parameter name, in SI or with units, in which equal indices belong to the same draw.
Uncertainty = Posterior | Fit | Mapping[str, Any]
NOMINAL = "nominal"
_FACTOR = Quantity("", "", "a factor")
_SCALE = Quantity("", "", "it", above=0)


@dataclass(frozen=True, init=False, repr=False)
class Scenario:
    """A condition that changes values of the model: ``Scenario(external_force="-0.1 N")``.

    Attributes:
        name: name in reports; by default a list of the changed values.
        values: changed values, in SI or as strings with units, by name: a field of the actuator or its law,
            "load" (normal force relative to its reference) or "drive_scale" (a factor on the voltage).
        factors: factors on values of the model (of each draw): ``Scenario(factors={"natural_frequency":
            0.95})``.
    """

    name: str
    values: Mapping[str, float | str]
    factors: Mapping[str, float]

    def __init__(
        self, name: str = "", *, factors: Mapping[str, float] | None = None, **values: float | str
    ) -> None:
        if not isinstance(name, str):
            raise QuantityError(f"Scenario.name = {name!r} must be a text; what differs is given by keyword")
        if not isinstance(factors, Mapping | None):
            raise QuantityError(f"Scenario.factors = {factors!r:.60} must be numbers by name")
        if not values and not factors:
            raise QuantityError("a Scenario says what differs, such as external_force='-0.1 N'")
        if twice := {*values} & {*(factors or {})}:
            raise QuantityError(f"Scenario.{min(twice)} is given a value and a factor")
        factors = {
            key: to_si(value, "", f"Scenario.factors[{key!r}]") for key, value in dict(factors or {}).items()
        }
        text = [f"{key} {value}" for key, value in values.items()]
        text += [f"{key} x {value:g}" for key, value in factors.items()]
        for key, value in (("name", name or ", ".join(text)), ("values", values), ("factors", factors)):
            object.__setattr__(self, key, value)

    def __repr__(self) -> str:
        return f"Scenario({self.name!r}, factors={dict(self.factors)}, {dict(self.values)})"


class ScenarioTable(NamedTuple):
    """Conditions in which a drive is judged: their `names`, and `columns`, arrays [conditions] by the name of
    each value that a condition changes, SI."""

    names: tuple[str, ...]
    columns: dict[str, Array]

    def part(self, which: NDArray[np.int64]) -> dict[str, Array]:
        return {name: column[which] for name, column in self.columns.items()}


def conditions_of(
    model: Actuator,
    scenarios: Sequence[Scenario | Mapping[str, Any]],
    uncertainty: Uncertainty | None,
    draws: int,
    seed: int,
) -> ScenarioTable:
    """Return all conditions: the unchanged model and every scenario, each with the model's own values and
    with the values of every draw.

    Args:
        model: the actuator.
        scenarios: scenarios, or mappings with the arguments of `Scenario`.
        uncertainty: uncertainty of the model; None: no draws.
        draws: number of draws from the uncertainty.
        seed: seed of the draws.

    Raises:
        QuantityError: a name that the model does not have, a value out of range, or as `drawn`.
    """
    if isinstance(scenarios, Scenario | Mapping | str):
        raise QuantityError(f"scenarios = {scenarios!r:.60} must be a list of them")
    cases: list[Scenario | None] = [None, *map(_scenario, scenarios)]
    rows = [(NOMINAL, dict[str, float]())]
    if uncertainty is not None:
        rows += [(f"draw {i + 1}", row) for i, row in enumerate(drawn(model, uncertainty, draws, seed))]
    names, found = list[str](), list[dict[str, float]]()
    for of_draw, row in rows:
        base = with_values(model, row) if row else model
        for case in cases:
            names.append(" ".join(n for n in (case.name if case else "", of_draw) if n and n != NOMINAL))
            found.append(row | (_changes(base, case) if case else {}))
    columns = {}
    for key in dict.fromkeys(key for one in found for key in one):
        bases = [with_values(model, row) if row else model for _, row in rows for _ in cases]
        columns[key] = np.array(
            [one[key] if key in one else own(base, key) for one, base in zip(found, bases, strict=True)]
        )
    # Values out of range raise an error here, before the search starts.
    for one in found:
        with_values(model, {key: value for key, value in one.items() if key not in SCALES})
    return ScenarioTable(tuple(name or NOMINAL for name in names), columns)


def _scenario(given: Scenario | Mapping[str, Any]) -> Scenario:
    if isinstance(given, Scenario):
        return given
    if isinstance(given, Mapping):
        return Scenario(**given)
    raise QuantityError(f"{given!r:.60} is no scenario: give design.Scenario(external_force='-0.1 N'), say")


def _changes(model: Actuator, case: Scenario) -> dict[str, float]:
    """Return the values that a scenario changes in a model, by name, SI; a factor multiplies the model's
    value.

    Raises:
        QuantityError: a name that the model does not have, or a value out of range.
    """
    known = [*free_names(model), *SCALES]
    for name in (*case.values, *case.factors):
        if name not in known:
            raise QuantityError(
                f"Scenario {case.name!r}: {name!r} is unknown{did_you_mean(name, known)}; "
                f"there are {', '.join(known)}"
            )
    of = quantities_within(model)
    changed = {}
    for name, value in case.values.items():
        quantity = of.get(name)
        changed[name] = (
            quantity.check(value, f"Scenario.{name}") if quantity else to_si(value, "", f"Scenario.{name}")
        )
    for name, factor in case.factors.items():
        changed[name] = own(model, name) * _FACTOR.check(factor, f"Scenario.factors[{name!r}]")
    for name in SCALES:
        _SCALE.check(changed.get(name, 1.0), f"Scenario.{name}")
    return changed


def own(model: Actuator, name: str) -> float:
    """Return a model's own value of a quantity that a scenario may change, SI; 1 for a scale of `SCALES`."""
    return 1.0 if name in SCALES else value_of(model, name)


def drawn(model: Actuator, source: Uncertainty, count: int, seed: int) -> list[dict[str, float]]:
    """Return `count` draws of the model's parameters, each a mapping from name to value, SI.

    Args:
        model: the actuator.
        source: posterior or arrays by name, from which rows are drawn with replacement; or a fit, from whose
            normal distribution, clipped at its bounds, values are drawn.
        count: number of draws.
        seed: seed of the draws.

    Raises:
        QuantityError: a parameter that the model does not have, no parameter of the actuator, arrays of
            unequal length, or a fit whose covariance is not finite.
    """
    random = np.random.default_rng([seed, 64])
    if isinstance(source, Posterior):
        source = {str(name): source.samples[name].values for name in source.samples.data_vars}
    if isinstance(source, Mapping):
        flat = {name: draws_in_si(model, name, values) for name, values in source.items()}
        sizes = {values.size for values in flat.values()}
        if len(sizes) != 1 or 0 in sizes:
            raise QuantityError(
                "uncertainty: of each parameter as many draws as of the others, and at least one"
            )
        rows = random.integers(0, sizes.pop(), count)
        found = {name: values[rows] for name, values in flat.items()}
    elif isinstance(source, Fit):
        covariance = source.uncertainty.covariance
        if not np.all(np.isfinite(covariance)):
            raise QuantityError(
                "no draws: the covariance of the fit is not finite, for its data leave a value open"
            )
        q = random.multivariate_normal(source.coordinates, covariance, count, method="eigh")
        found = {
            p.name: p.values(np.clip(q[:, i], p.coordinate(p.lower), p.coordinate(p.upper)))
            for i, p in enumerate(source.parameters)
        }
        found = {name: np.broadcast_to(v, count) for name, v in source.ties(found).items()}
    else:
        raise QuantityError(f"uncertainty = {source!r:.60} must be a posterior, a fit or arrays by name")
    kept, known = {n: v for n, v in found.items() if n not in NOT_OF_ACTUATOR}, free_names(model)
    for name in kept:
        if name not in known:
            raise QuantityError(
                f"the uncertainty is of another model: it has {name!r}{did_you_mean(name, known)}"
                f", and this one has {', '.join(known)}"
            )
    if not kept:
        raise QuantityError("the uncertainty has no parameter of the actuator")
    return [{name: float(values[i]) for name, values in kept.items()} for i in range(count)]
