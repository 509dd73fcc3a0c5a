r"""Comparison of contacts: changes of the friction parameters with surface, load and condition.

The logarithm of each parameter follows a linear model over all fits i [dersimonian1986; knapp2003]:

.. math:: \ln \theta_i = b_0 + \sum_j b_j x_{ij} + u_i + e_i

For a numeric condition x is its logarithm (b is then an exponent: 1 for Amontons' law, 1/3 for the stiffness
of a ball); for a named one x is 0 or 1 (e^b is the ratio to the first name). e_i has the variance of the fit,
and u_i the variance τ² by which contacts scatter in addition, from place to place or by assembly. τ² comes
from the restricted likelihood, intervals from Student's t. Without more fits than coefficients τ² is unknown,
and the intervals apply to these individual contacts, not to the surfaces in general.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...estimate import Fit
from ...estimate.shown import preformatted
from ...quantities.records import did_you_mean
from ...quantities.units import QuantityError, with_unit

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
# Type of the values of a condition, one per contact: numbers, quantities with units, or names.
Condition = Sequence[float | str]

LEVEL = 0.95
# Largest scatter τ of the logarithms of a parameter that is searched; it corresponds to a factor of 20.
MOST_SCATTER = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class ContactComparison:
    """Result of `compare_contacts`.

    Attributes:
        effects: over "parameter" and "effect": `exponent` (NaN for a named condition) or `ratio` (NaN for a
            numeric one); `low` and `high` of its 95 % interval; `p`, the probability of such a value without
            an effect, corrected for all tests by Holm's method; and `moved`, True if p is below 0.05.
        values: over "contact" and "parameter": `value`, `low`, `high` (95 % interval) of each fit, in the
            parameter's unit (coordinate "unit").
        scatter: over "parameter": the factor e^τ within which 68 % of equal contacts lie; NaN: unknown.
        remarks: sentences on parameters that could not be compared.
    """

    effects: xr.Dataset
    values: xr.Dataset
    scatter: xr.DataArray
    remarks: tuple[str, ...]

    _repr_html_ = preformatted

    def __repr__(self) -> str:
        return self.report()

    def moved(self, effect: str) -> list[str]:
        """Return the names of the parameters that change significantly (corrected p below 0.05) with an
        effect, given by its name, such as "normal_force" or "surface: ground over lapped".

        Raises:
            QuantityError: there is no such effect.
        """
        known = self.effects["effect"].values.tolist()
        if effect not in known:
            raise QuantityError(
                f"there is no effect {effect!r}{did_you_mean(effect, known)}: there are {', '.join(known)}"
            )
        rows = self.effects["moved"].sel(effect=effect)
        return [str(name) for name in rows["parameter"].values[rows.values]]

    def report(self) -> str:
        """Return a text with a line for each parameter and effect, the scatter, and parameters that could not
        be compared."""
        lines = []
        for name in self.effects["parameter"].values:
            for effect in self.effects["effect"].values:
                lines.append(
                    _sentence(self.effects.sel(parameter=name, effect=effect), str(name), str(effect))
                )
            scatter = float(self.scatter.sel(parameter=name))
            if np.isfinite(scatter):
                lines.append(f"{name} scatters from contact to contact by a factor of {scatter:.3g} (68 %)")
        return "\n".join([*lines, *self.remarks])


class _Effect(NamedTuple):
    """A column of the design matrix of the regression: its `name`; `column`, its values [fits]; and
    `exponent`, True if its coefficient is an exponent, False if it is the logarithm of a ratio."""

    name: str
    column: Array
    exponent: bool


def compare_contacts(
    fits: Mapping[str, Fit],
    conditions: Mapping[str, Condition],
    *,
    parameters: Sequence[str] | None = None,
) -> ContactComparison:
    """Compare the friction parameters of contacts under different conditions.

    Args:
        fits: fit of each contact, by name; all with the same law.
        conditions: differences between the contacts, one value per fit, in order: numbers or quantities above
            0 (``"normal_force": ["1 N", "2 N", "4 N"]``), or names (``"surface": ["lapped", "ground",
            "ground"]``), of which the first is the reference. Conditions with equal values are ignored.
        parameters: names of the parameters to compare; by default, all positive ones that every fit has.
            Fits without a standard error of a parameter, or with a value <= 0, are left out for it.

    Returns:
        The comparison; its `report` is a text.

    Raises:
        QuantityError: fewer than two fits; a condition with wrong values or another count; conditions that do
            not differ, or vary together so that their effects cannot be separated; a parameter that a fit
            does not have; or no parameter that can be compared.
    """
    import xarray as xr

    names = list(fits)
    effects = _effects(conditions, len(names))
    known = [name for name in fits[names[0]].values if all(name in one.values for one in fits.values())]
    for name in parameters or ():
        if name not in known:
            raise QuantityError(f"not every fit has {name!r}{did_you_mean(name, known)}: {', '.join(known)}")
    positive = [n for n in known if all(one.values[n] > 0.0 for one in fits.values())]
    rows, scatters, remarks, compared = [], [], [], []
    for name in parameters or positive:
        values = np.array([one.values[name] for one in fits.values()])
        errors = np.array([one.standard_errors[name] for one in fits.values()]) / values
        sure = np.isfinite(errors) & (errors > 0.0) & (values > 0.0)
        left_out = [one for one, kept in zip(names, sure, strict=True) if not kept]
        if left_out:
            remarks.append(f"{name} is not determined by {', '.join(left_out)}, which are left out of it")
        design = np.column_stack([np.ones(len(names)), *(effect.column for effect in effects)])[sure]
        if sure.sum() < design.shape[1] or np.linalg.matrix_rank(design) < design.shape[1]:
            remarks.append(f"{name} is known of too few contacts to tell the conditions apart")
            continue
        found = _fitted(design, np.log(values[sure]), errors[sure])
        compared.append(name)
        rows.append(found)
        scatters.append(np.exp(found.scatter))
    if not compared:
        raise QuantityError("no parameter can be compared: " + "; ".join(remarks or ["no value is above 0"]))
    if len(names) == 1 + len(effects):
        remarks.append(
            "as many coefficients as fits: how contacts scatter is not known, nor in the intervals"
        )
    return ContactComparison(
        _table(compared, effects, rows),
        _values(fits, compared),
        xr.DataArray(scatters, dims="parameter", coords={"parameter": compared}),
        tuple(remarks),
    )


class _FittedEffects(NamedTuple):
    """Result of the regression of one parameter: `coefficients` of the effects [effects], `half_widths` of
    their 95 % intervals, their p values without Holm's correction (`chances`), and the `scatter` τ (NaN:
    unknown)."""

    coefficients: Array
    half_widths: Array
    chances: Array
    scatter: float


def _fitted(design: Array, logarithms: Array, errors: Array) -> _FittedEffects:
    freedom = len(logarithms) - design.shape[1]

    def at(variance: float) -> tuple[Array, Array, float]:
        """Return the coefficients, their covariance, and -2 times the restricted log-likelihood (without a
        constant), if contacts scatter with the variance τ² = `variance` in addition to the errors of the
        fits."""
        weight = 1.0 / (errors**2 + variance)
        normal = design.T @ (weight[:, None] * design)
        covariance = np.linalg.inv(normal)
        b = covariance @ (design.T @ (weight * logarithms))
        squares = float(np.sum(weight * (logarithms - design @ b) ** 2))
        likelihood = squares - float(np.sum(np.log(weight))) + float(np.linalg.slogdet(normal)[1])
        return b, np.asarray(covariance, float), likelihood

    scatter = np.nan
    if freedom > 0:
        found: Any = scipy.optimize.minimize_scalar(
            lambda tau: at(tau**2)[2], bounds=(0.0, MOST_SCATTER), method="bounded", options={"xatol": 1e-6}
        )
        scatter = 0.0 if at(0.0)[2] <= found.fun else float(found.x)
    b, covariance, _ = at(0.0 if freedom == 0 else scatter**2)
    deviations = np.sqrt(np.diag(covariance))[1:]
    of = scipy.stats.t(freedom) if freedom else scipy.stats.norm()
    chances = 2.0 * of.sf(np.abs(b[1:]) / deviations)
    return _FittedEffects(b[1:], of.ppf(0.5 + LEVEL / 2) * deviations, chances, scatter)


def _effects(conditions: Mapping[str, Condition], count: int) -> list[_Effect]:
    if count < 2:
        raise QuantityError(f"{count} fit: a comparison takes at least two")
    found: list[_Effect] = []
    for name, given in conditions.items():
        if isinstance(given, str) or len(given) != count:
            raise QuantityError(f"{name} must have a value for each of the {count} fits")
        numbers = _numbers(name, given)
        if numbers is not None:
            if np.ptp(numbers) > 0.0:
                logarithms = np.log(numbers)
                found.append(_Effect(name, np.asarray(logarithms - logarithms.mean(), float), True))
            continue
        levels = list(dict.fromkeys(given))
        for level in levels[1:]:
            column = np.array([float(one == level) for one in given])
            found.append(_Effect(f"{name}: {level} over {levels[0]}", column, False))
    if not found:
        raise QuantityError("conditions do not differ between the fits: there is nothing to compare")
    design = np.column_stack([np.ones(count), *(effect.column for effect in found)])
    if np.linalg.matrix_rank(design) < design.shape[1]:
        listed = ", ".join(effect.name for effect in found)
        raise QuantityError(f"conditions vary together ({listed}): {count} fits cannot tell them apart")
    return found


def _numbers(name: str, given: Sequence[float | str]) -> Array | None:
    """Return the values of a condition in base units; None for names: texts, none of which is a quantity.

    Raises:
        QuantityError: some values are numbers or quantities and others are not, units differ, or a number is
            not above 0.
    """
    quantities, others = [], []
    for one in given:
        try:
            quantities.append(with_unit(str(one)).to_base_units())
        except QuantityError:
            others.append(str(one))
    if others and not quantities:
        return None
    if others:
        raise QuantityError(
            f"{name} must be numbers or quantities, or names, not both: {others[0]!r} is no quantity, and "
            "other values are"
        )
    if len({str(one.units) for one in quantities}) > 1:
        raise QuantityError(f"{name} has values of different units: {', '.join(map(str, given))}")
    numbers = np.array([float(one.magnitude) for one in quantities])
    if not np.all(np.isfinite(numbers) & (numbers > 0.0)):
        raise QuantityError(
            f"{name} = {', '.join(map(str, given))} is out of range: a number must be > 0, for its logarithm "
            "is what counts; names ('dry', 'damp') are compared as such"
        )
    return numbers


def _table(compared: list[str], effects: list[_Effect], rows: list[_FittedEffects]) -> xr.Dataset:
    import xarray as xr

    b, half = (np.array([row[i] for row in rows]) for i in (0, 1))
    exponent = np.array([effect.exponent for effect in effects])
    chances = _holm(np.array([row.chances for row in rows]))

    def shown(values: Array) -> tuple[tuple[str, str], Array]:
        return ("parameter", "effect"), np.where(exponent, values, np.exp(values))

    return xr.Dataset(
        {
            "exponent": (("parameter", "effect"), np.where(exponent, b, np.nan)),
            "ratio": (("parameter", "effect"), np.where(exponent, np.nan, np.exp(b))),
            "low": shown(b - half),
            "high": shown(b + half),
            "p": (("parameter", "effect"), chances),
            "moved": (("parameter", "effect"), chances < 1.0 - LEVEL),
        },
        coords={"parameter": compared, "effect": [effect.name for effect in effects]},
    )


def _holm(chances: Array) -> Array:
    """Return p values after Holm's correction for the number of tests, in the shape of `chances`, the p
    values without correction. The correction limits the probability that any finding is false [holm1979]."""
    order = np.argsort(chances, axis=None)
    ordered = chances.ravel()[order] * np.arange(chances.size, 0, -1)
    found = np.empty(chances.size)
    found[order] = np.minimum(np.maximum.accumulate(ordered), 1.0)
    return found.reshape(chances.shape)


def _values(fits: Mapping[str, Fit], compared: list[str]) -> xr.Dataset:
    import xarray as xr

    ends = [one.confidence_intervals() for one in fits.values()]
    columns = {
        "value": [[one.values[name] for name in compared] for one in fits.values()],
        "low": [[of[name][0] for name in compared] for of in ends],
        "high": [[of[name][1] for name in compared] for of in ends],
    }
    units = {p.name: p.unit for p in next(iter(fits.values())).shown}
    return xr.Dataset(
        {key: (("contact", "parameter"), np.array(rows)) for key, rows in columns.items()},
        coords={
            "contact": list(fits),
            "parameter": compared,
            "unit": ("parameter", [units[name] for name in compared]),
        },
    )


def _sentence(row: xr.Dataset, name: str, effect: str) -> str:
    low, high, p = (float(row[key]) for key in ("low", "high", "p"))
    exponent = float(row["exponent"])
    value, what = (exponent, "the power") if np.isfinite(exponent) else (float(row["ratio"]), "a factor of")
    said = f"{what} {value:.3g} [{low:.3g}, {high:.3g}]"
    how = f"moved with {effect}" if bool(row["moved"]) else f"did not visibly move with {effect}"
    return f"{name} {how}: {said}, p = {p:.2g}"
