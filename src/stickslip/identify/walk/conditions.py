r"""Test whether fitted parameters depend on conditions of the experiment, such as voltage or temperature.

Recordings have attributes for these conditions. Recordings with the same value of the attribute are fitted
together; in addition, all recordings are fitted at once. If one set of values explains all recordings, the
sum of squares S of the common fit exceeds the sum of the separate fits' :math:`S_g` by no more than noise
causes. The F-test uses

.. math:: F = \frac{(S - \sum_g S_g) / (k (G - 1))}{\sum_g S_g / (n - k G)}

for k values, G conditions and n independent samples, with k (G - 1) and n - k G degrees of freedom. A single
value changes with the condition if its estimates scatter by more than their uncertainty (Cochran's Q).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
import xarray as xr

from ...estimate.lack import independent_samples
from ...estimate.result import Fit
from ...estimate.shown import preformatted
from ...gate.results import json_attribute
from ...physics.actuator import Actuator
from ...quantities.records import did_you_mean
from ...quantities.units import to_si, with_prefix
from ...recording import RecordingError
from ...waveform.signal import Waveform
from ..recorded.channels import drives_of, names_of, recordings_of
from .friction import identify_friction
from .position_channel import CHANNEL

# SI units of common condition attributes; any other attribute is a plain number unless `unit` is given.
UNITS = {"voltage": "V", "frequency": "Hz", "temperature": "K", "humidity": "", "load": "kg"}
# Significance level of both tests: with a lower probability of chance, parameters depend on the condition.
SURE = 0.01


@dataclass(frozen=True, eq=False)
class Conditions:
    """Fits of the same model under several conditions.

    Attributes:
        by: name of the attribute that differs.
        unit: SI unit of the attribute; "" for a plain number.
        at: value of the attribute in each condition, ascending, in SI.
        fits: one fit for each condition, in the order of `at`.
        together: one fit to all recordings.
        chance: probability that noise alone makes one common set of values so much worse than separate sets
            (F-test).
        moving: for each parameter by name, the probability that noise alone makes its estimates scatter so
            much (Cochran's Q); NaN if fewer than two fits give it an uncertainty.
    """

    by: str
    unit: str
    at: tuple[float, ...]
    fits: tuple[Fit, ...]
    together: Fit
    chance: float
    moving: dict[str, float]

    @property
    def one_set_explains_all(self) -> bool:
        """Return True unless the F-test rejects one common set of values for all conditions."""
        return self.chance >= SURE

    @property
    def table(self) -> xr.Dataset:
        """Return a dataset of the estimates with dimensions "condition" and "parameter", in the parameters'
        units.

        Its variables are value, low and high (ends of the 95 % interval) and standard_error; and `moves` over
        "parameter", the probabilities in `moving`.
        """
        names = [p.name for p in self.together.shown]
        ends = [fit.confidence_intervals() for fit in self.fits]
        over = ("condition", "parameter")
        columns: dict[str, Any] = {
            "value": (over, [[fit.values[n] for n in names] for fit in self.fits]),
            "low": (over, [[e[n][0] for n in names] for e in ends]),
            "high": (over, [[e[n][1] for n in names] for e in ends]),
            "standard_error": (over, [[fit.standard_errors[n] for n in names] for fit in self.fits]),
            "moves": ("parameter", [self.moving[n] for n in names]),
        }
        at = ("condition", list(self.at), {"units": self.unit, "long_name": self.by})
        units = ("parameter", [p.unit for p in self.together.shown])
        return xr.Dataset(columns, coords={"condition": at, "parameter": names, "unit": units})

    @property
    def statement(self) -> str:
        """Return the result of the F-test in one sentence, with the names of parameters that change."""
        if self.one_set_explains_all:
            return f"one set of values explains all {self.by} (chance {self.chance:.2g} of more by noise)"
        moves = [name for name, chance in self.moving.items() if chance < SURE]
        which = f": {' and '.join(moves)} move{'s' * (len(moves) == 1)}" if moves else ""
        return f"no one set of values explains all {self.by} (chance {self.chance:.2g}){which}"

    _repr_html_ = preformatted

    def report(self) -> str:
        """Return a text table of estimates and 95 % intervals, one line for each condition, one line of the
        probabilities in `moving`, and the statement."""
        names = [p.name for p in self.together.shown]
        lines = ["  ".join([f"{self.by:>14}", *(f"{name:>32}" for name in names)])]
        for value, fit in zip(self.at, self.fits, strict=True):
            ends = fit.confidence_intervals()
            cells = [f"{fit.values[n]:.5g} [{ends[n][0]:.4g}, {ends[n][1]:.4g}]" for n in names]
            lines.append("  ".join([f"{with_prefix(value, self.unit, 4):>14}", *(f"{c:>32}" for c in cells)]))
        moves = [f"{self.moving[name]:.2g}" for name in names]
        lines.append("  ".join([f"{'chance':>14}", *(f"{c:>32}" for c in moves)]))
        return "\n".join([*lines, self.statement])


def identify_conditions(
    recordings: Sequence[xr.Dataset],
    model: Actuator,
    free: Sequence[str],
    by: str,
    *,
    drive: Waveform | Sequence[Waveform | None] | None = None,
    unit: str | None = None,
    **options: Any,
) -> Conditions:
    """Fit the walks of each condition separately, and all walks together, and test whether the values depend
    on the condition.

    The separate fits start at the values of the common fit and have the same free parameters; the result
    contains all fits and tests.

    Args:
        recordings: each with an attribute `by` (a number in SI or a text with a unit), or with a variable of
            that name from an experiment file.
        model, free, drive: as for `identify_friction`.
        by: name of the condition: "voltage", "frequency", "temperature", "humidity", "load", or any other
            attribute.
        unit: SI unit of the attribute; by default the usual one of the names above, or none (a plain number).
        options: further arguments of `identify_friction`; here `diagnose` is False by default, because
            changes with the condition are tested first.

    Raises:
        RecordingError: a recording has no such attribute, its value is the same in all recordings, or see
            `identify_friction`.
        QuantityError, FitError: as for `identify_friction`; or an attribute has another unit than `unit`.
    """
    found, unit = recordings_of(recordings), UNITS.get(by, "") if unit is None else unit
    drives, known = drives_of(drive, found), _values_of(found, by, unit)
    at = sorted(set(known))
    if len(at) < 2:
        raise RecordingError(f"{by} is {with_prefix(at[0], unit, 4)} in all recordings: nothing differs")
    together = identify_friction(found, model, free, drive=drives, **{"diagnose": False, **options})
    # Each separate fit needs the free parameters of the common fit, or sums of squares cannot be compared.
    own = [p.name for p in together.parameters if p.name not in free]
    initial = {n: together.values[n] for n in CHANNEL if n in together.values}
    settings = {**options, "channel": (), "initial": initial, "diagnose": False}
    fits = []
    for value in at:
        chosen = [i for i, one in enumerate(known) if one == value]
        fits.append(
            identify_friction(
                [found[i] for i in chosen],
                together.model,
                [*free, *own],
                drive=[drives[i] for i in chosen],
                **settings,
            )
        )
    moving = {p.name: _moves(fits, p.name) for p in together.shown}
    return Conditions(by, unit, tuple(at), tuple(fits), together, _chance(together, fits), moving)


def _chance(together: Fit, fits: Sequence[Fit]) -> float:
    """Return the p-value of the F-test: the probability that noise alone makes the sum of squares of the
    common fit exceed that of the separate fits so much.

    It is 1 if there are too few samples for the test or the separate fits leave no residuals.
    """
    left = sum(fit.cost for fit in fits)
    k = len(together.parameters)
    share = float(np.mean([independent_samples(r) / r.size for fit in fits for r in fit.residuals]))
    freedom = share * together.n_data - k * len(fits)
    more = k * (len(fits) - 1)
    if left <= 0.0 or freedom <= 0.0:
        return 1.0
    grown = max(together.cost - left, 0.0) / left * freedom
    return float(scipy.stats.f.sf(grown / more, more, freedom))


def _moves(fits: Sequence[Fit], name: str) -> float:
    """Return the p-value of Cochran's Q: the probability that the estimates of a constant parameter scatter
    so much.

    The test uses search coordinates (such as logarithms of the values) and their variances; it is NaN if
    fewer than two fits give a finite variance.
    """
    place = [p.name for p in fits[0].shown].index(name)
    q = np.array([fit.shown[place].coordinate(fit.values[name]) for fit in fits])
    spread = [fit.ties.extended(fit.values, fit.uncertainty).covariance for fit in fits]
    variance = np.array([one[place, place] for one in spread])
    told = np.isfinite(variance) & (variance > 0.0)
    if np.count_nonzero(told) < 2:
        return math.nan
    weights = 1.0 / variance[told]
    mean = float(weights @ q[told] / weights.sum())
    return float(scipy.stats.chi2.sf(weights @ (q[told] - mean) ** 2, np.count_nonzero(told) - 1))


def _values_of(recordings: Sequence[xr.Dataset], by: str, unit: str) -> list[float]:
    """Return the value of the attribute (or stored variable) `by` of each recording, converted to `unit`
    (SI).

    Raises:
        RecordingError: a recording has no such attribute.
        QuantityError: a value has another unit.
    """
    found = []
    for recording, name in zip(recordings, names_of(recordings), strict=True):
        attributes = {**_variables(recording), **recording.attrs}
        if by not in attributes:
            hint = did_you_mean(by, map(str, attributes))
            raise RecordingError(f"{name} does not say its {by!r}{hint}")
        found.append(to_si(attributes[by], unit, f"{by} of {name}"))
    return found


def _variables(recording: xr.Dataset) -> dict[str, Any]:
    """Return the variables of the experiment by name that are stored in a recording's attribute "variables";
    empty without the attribute."""
    return json_attribute(recording.attrs, "variables")
