"""Verification: predictions of a fitted model compared with recordings that the fit has not used [kang2007,
5.4 and appendix 6]."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate.goodness import Goodness, goodness, pooled_r_squared, pooled_rmse
from ..estimate.judgement import DEFAULT
from ..estimate.lack import Lack, lack_of_fit
from ..estimate.problem import FitError
from ..estimate.result import Fit
from ..estimate.shown import preformatted
from ..quantities.records import did_you_mean, same
from ..quantities.units import ANGLE, QuantityError, to_si, with_prefix
from ..recording import RecordingError, make_recording
from ..recording.conversion import is_number
from .loops.missing import MEASURED
from .recorded.channels import channel, drives_of, names_of, recordings_of
from .recorded.drives import SeenDrive, periodic_part
from .recorded.known_noise import known_noise, more_than_white, white_noise
from .walk.prediction import Predictor


class Requirement(NamedTuple):
    """Limit of a figure of merit that every verified recording must meet.

    Fields: `figure`, one of `FIGURES`; `relation`, ">", ">=", "<" or "<="; `limit`, SI; `unit` of the limit,
    m or rad, and None for a plain number.
    """

    figure: str
    relation: str
    limit: float
    unit: str | None = None

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """Return the requirement in a text such as "r_squared > 0.99", "rmse <= 100 nm" or "net_step_error <
        2 %".

        Raises:
            QuantityError: the text has another form or names another figure, or the unit is wrong or missing.
        """
        found = re.fullmatch(r"\s*([a-z_]+)\s*(>=|<=|>|<)\s*(.+?)\s*", text)
        if not found:
            raise QuantityError(f"{text!r} is no requirement: write one like 'r_squared > 0.99'")
        figure, relation, limit = found.groups()
        if figure not in FIGURES:
            hint = did_you_mean(figure, FIGURES)
            raise QuantityError(f"{figure!r} cannot be required{hint}: there are {', '.join(FIGURES)}")
        if figure == "net_step_error" and limit.endswith("%"):
            return cls(figure, relation, to_si(limit[:-1], "", figure) / 100.0)
        unit = FIGURES[figure]
        if unit and is_number(limit):  # without a unit, 100 would mean 100 m: a limit that is always met
            raise QuantityError(
                f"{text.strip()!r} has no unit: write one behind the number, as in {figure} {relation} 100 "
                f"nm (of what turns, {figure} {relation} 5 urad)"
            )
        if unit and limit.endswith("rad"):
            unit = ANGLE.unit(unit)
        return cls(figure, relation, to_si(limit, unit, figure), unit or None)

    def met(self, value: float) -> bool:
        """Return True if a value, SI, fulfils the requirement; False for NaN."""
        return bool(_RELATIONS[self.relation](value, self.limit))

    def broken(self, value: float, unit: str | None = None) -> str:
        """Return the sentence that a value (SI) violates the limit, with enough digits to distinguish value
        and limit; `unit` is the SI unit of both, by default that of the figure (m)."""
        own = FIGURES[self.figure] if unit is None else unit
        ends = [[self._shown(x, own, digits) for x in (value, self.limit)] for digits in (5, 7, 9, 12)]
        apart = next((pair for pair in ends if pair[0] != pair[1]), ends[-1])
        return f"{self.figure} is {apart[0]}, which is not {self.relation} {self._shown(self.limit, own, 12)}"

    def _shown(self, value: float, unit: str, digits: int) -> str:
        if self.figure == "net_step_error":
            return f"{100.0 * value:.{digits - 2}g} %"
        return with_prefix(value, unit, digits)


_RELATIONS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt, ">=": operator.ge, "<": operator.lt, "<=": operator.le,
}  # fmt: skip
# Figures of merit that a requirement may name, with their SI units.
FIGURES = {
    "r_squared": "",
    "rmse": "m",
    "residual_over_noise": "",
    "largest_error": "m",
    "net_step_error": "",
}
# Largest standard deviation of a residual about its mean, relative to its rms, that is called an offset.
MOSTLY = 0.5
_WHY_NOT = {
    "r_squared": "what was measured is constant",
    "net_step_error": "the drive is not known as a waveform of two periods or more: name it, as drive of the "
    "recording in a verification file, or of verify",
    "residual_over_noise": "nothing is recorded at rest, and nothing repeats, that shows the noise",
}


@dataclass(frozen=True, eq=False)
class Verification:
    """Comparison of a model's predictions with recordings.

    Attributes:
        observed: name of the predicted channel.
        unit: unit of the channel.
        recordings: goodness of the prediction of each recording.
        predictions: for each recording, a dataset over "time" with measured, predicted and residual
            (predicted minus measured).
        steps: for each recording the measured and the predicted net step per period, in `unit`; NaN without a
            drive of two periods or more.
        lacks: comparison of each residual with the recording's noise, see `lack_of_fit`.
        remarks: sentences on recordings without separate noise, and on those that differ by a constant.
        unexplained: sentences on recordings without separate noise whose residual exceeds their white noise
            although the fit has doubts, or exceeds that of measured loops (`loops.missing`).
        taken: sentences on the drive of each walk, if none was given.
    """

    observed: str
    unit: str
    recordings: tuple[Goodness, ...]
    predictions: tuple[xr.Dataset, ...]
    steps: tuple[tuple[float, float], ...]
    lacks: tuple[Lack, ...] = ()
    remarks: tuple[str, ...] = ()
    unexplained: tuple[str, ...] = ()
    taken: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        return same(self, other)

    @property
    def statements(self) -> tuple[str, ...]:
        """Return one or more sentences on each recording that the model, so fitted, does not explain."""
        return (*(one.statement for one in self.lacks if one.seen), *self.unexplained)

    @property
    def r_squared(self) -> float:
        """Return (SST - SSE)/SST over all recordings: SST, the squares of the measured values about each
        recording's mean; SSE, those of the residuals [kang2007, appendix 6]."""
        return pooled_r_squared(self.recordings)

    @property
    def rmse(self) -> float:
        """Return the root mean square of all residuals, in the unit of the channel."""
        return pooled_rmse(self.recordings)

    @property
    def table(self) -> xr.Dataset:
        """Return a dataset over "recording" with r_squared, rmse, residual_over_noise, largest_error,
        net_step, net_step_error and n_data.

        net_step is the measured step per period, and net_step_error the relative error abs(predicted/measured
        - 1). residual_over_noise is NaN if the noise is not known independently of the residuals.
        """
        errors = [float(np.max(np.abs(p["residual"].values))) for p in self.predictions]
        columns = {
            "r_squared": ([g.r_squared for g in self.recordings], ""),
            "rmse": ([g.rmse for g in self.recordings], self.unit),
            "residual_over_noise": ([one.ratio for one in self.lacks] or [math.nan] * len(errors), ""),
            "largest_error": (errors, self.unit),
            "net_step": ([measured for measured, _ in self.steps], self.unit),
            "net_step_error": ([_step_error(*pair) for pair in self.steps], ""),
            "n_data": ([g.n_data for g in self.recordings], ""),
        }
        return xr.Dataset(
            {name: ("recording", values, {"units": unit}) for name, (values, unit) in columns.items()},
            coords={"recording": [g.name for g in self.recordings]},
        )

    def unmet(self, requirements: Sequence[Requirement]) -> list[str]:
        """Return a sentence for each recording and requirement that is not met.

        A figure that does not exist (NaN) is not met. But recordings without a net step are not checked
        against the net-step requirement, if another recording has one.

        Raises:
            QuantityError: a requirement is in another unit than the channel, such as m instead of rad.
        """
        table = self.table
        sentences = []
        for wanted in requirements:
            values, unit = table[wanted.figure].values, str(table[wanted.figure].attrs["units"])
            if wanted.unit not in (None, unit):
                said = f"{wanted.figure} {wanted.relation} {with_prefix(wanted.limit, str(wanted.unit))}"
                raise QuantityError(f"{said}: what was measured is in {unit}")
            judged = np.ones(values.size, dtype=bool)
            if wanted.figure == "net_step_error" and np.any(np.isfinite(values)):
                judged = np.isfinite(values)
            for name, value in zip(table["recording"].values[judged], values[judged], strict=True):
                if not math.isfinite(value):
                    sentences.append(f"{name}: {wanted.figure} does not exist; {_WHY_NOT[wanted.figure]}")
                elif not wanted.met(float(value)):
                    sentences.append(f"{name}: {wanted.broken(float(value), unit)}")
        return sentences

    def report(self) -> str:
        """Return a text table with one line for each recording and, if there are several, one for all; then
        statements, remarks and the drives that were taken."""
        width = max(len("recording"), *(len(g.name) for g in self.recordings))
        lines = [
            f"prediction of {self.observed} [{self.unit}]",
            f"{'recording':{width}}  {'r^2':9}  {'rmse':10}  residual/noise  net step error  data",
        ]
        ratios = self.table["residual_over_noise"].values
        rows = [
            (g.name, g.r_squared, g.rmse, _ratio(ratio), _percent(_step_error(*pair)), g.n_data)
            for g, ratio, pair in zip(self.recordings, ratios, self.steps, strict=True)
        ]
        if len(rows) > 1:
            rows.append(("all", self.r_squared, self.rmse, "", "", sum(g.n_data for g in self.recordings)))
        return "\n".join(
            [
                *lines,
                *(f"{n:{width}}  {r:9.6f}  {e:<10.4g}  {o:14}  {s:14}  {k}" for n, r, e, o, s, k in rows),
                *self.statements,
                *self.remarks,
                *self.taken,
            ]
        )

    _repr_html_ = preformatted

    def to_dict(self) -> dict[str, Any]:
        """Return the results for JSON: "observed", "unit", "r_squared", "rmse", "recordings" (for each name
        its figures of merit), "statements" and "drives" (both lists of sentences). Numbers that do not exist
        (r^2 of a constant, a net step) are None."""
        table = self.table
        return {
            "observed": self.observed,
            "unit": self.unit,
            "r_squared": _finite(self.r_squared),
            "rmse": self.rmse,
            "recordings": {
                str(name): {key: _finite(column.values[i].item()) for key, column in table.items()}
                for i, name in enumerate(table["recording"].values)
            },
            "statements": list(self.statements),
            "drives": list(self.taken),
        }


def _step_error(measured: float, predicted: float) -> float:
    return abs(predicted / measured - 1.0) if measured else math.nan


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %" if math.isfinite(share) else "-"


def _ratio(number: float) -> str:
    return f"{number:.3g}" if math.isfinite(number) else "-"


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


def net_step(time: NDArray[np.float64], position: NDArray[np.float64], drive: Any) -> float:
    """Return the net displacement per period of a repeated drive, in the unit of the position; NaN without a
    drive, or with fewer than two periods.

    The net displacement is the mean position over the last period minus the mean over the second, divided by
    the number of periods between them. With only two periods the first is used, although it starts at rest.
    Means use all samples; differences of peaks [kang2007, appendix 9] would contain the noise of single
    samples. For a sequence of drives, the first periodic part counts; `drive` is in the time of the samples.
    """
    begin, periodic = periodic_part(drive)
    if periodic is None:
        return math.nan
    period = float(periodic.period)
    count = math.floor(min(periodic.duration, float(time[-1]) - begin) / period + 1e-6)
    if count < 2:
        return math.nan

    def mean(first: float) -> float:
        inside = (time >= first) & (time < first + period * (1.0 - 1e-9))
        return float(np.mean(position[inside])) if np.any(inside) else math.nan

    first = 1 if count > 2 else 0
    return (mean(begin + (count - 1) * period) - mean(begin + first * period)) / (count - 1 - first)


# Names of observed values in messages, by unit.
_KINDS = {"m": "positions", "rad": "positions", "N": "forces", "N m": "torques"}


def _unjudged(
    lacks: Sequence[Lack],
    goods: Sequence[Goodness],
    measured: Sequence[NDArray[np.float64]],
    doubts: Sequence[str],
) -> tuple[list[str], list[str]]:
    """Return two lists of sentences on recordings whose noise is not known independently and whose residuals
    exceed their white noise: a remark on each; and statements on those that the model does not explain,
    because the fit has `doubts` or, for forces, the residual exceeds `MEASURED` of the range."""
    remarks, unexplained = [], []
    for lack, good, x in zip(lacks, goods, measured, strict=True):
        words = (good.name, good.unit, _KINDS.get(good.unit, "values"), "the model does not explain it")
        said = "" if lack.against else more_than_white(good.rmse, white_noise(x), x, words)
        if not said:
            continue
        remarks.append(said)
        if good.unit in ("N", "N m") and good.rmse > MEASURED * float(np.ptp(x)) > 0.0:
            share = 100.0 * good.rmse / float(np.ptp(x))
            unexplained.append(f"the model does not explain {good.name}: {share:.2g} % of its range is left")
        unexplained += [f"the model does not explain {good.name}: {doubt}" for doubt in doubts]
    return remarks, unexplained


def _said_offsets(goods: Sequence[Goodness], left: Sequence[NDArray[np.float64]]) -> list[str]:
    """Return a sentence on each recording whose residual (predicted minus measured, `left`) is mostly a
    constant offset."""
    said = []
    for good, r in zip(goods, left, strict=True):
        if float(r.std()) < MOSTLY * good.rmse:
            constant = with_prefix(-float(r.mean()), good.unit, 3)
            said.append(
                f"most of what is left of {good.name} is an offset of {constant}: of the position's zero, or "
                "of a walk that began before the recording; a fit may free it, a prediction does not"
            )
    return said


def verify(
    fit: Fit | Predictor,
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    drive: Any | Sequence[Any] | None = None,
) -> Verification:
    """Compare recordings with the predictions of a fitted model, without a new fit; return the comparison.

    Args:
        fit: result of an identification that builds a model, or a `Predictor`.
        recordings: with the channels that the identification needed.
        drive: waveform of each recording, or one for all, in the recording's time. By default, a walk's own
            is used: see `taken_drive`.

    Raises:
        RecordingError: a channel is missing, too short, not finite or in another unit than the fit's; the
            prediction is not finite; or there is another number of waveforms than recordings.
        QuantityError: positions are in m and the model of a `Predictor` moves in rad, or the other way round.
        ValueError: `fit` is neither a fit nor a `Predictor`.
        FitError: the fit cannot predict a recording; the message says why, and which fit can.
    """
    if not hasattr(fit, "predict"):
        raise ValueError(
            f"{type(fit).__name__} is no fit: give what an identification returns, or Predictor(actuator)"
        )
    if fit.predict is None:
        raise FitError(f"this fit predicts no recording: {fit.unpredicted or 'it has no model'}")
    found = recordings_of(recordings)
    names, drives = names_of(found), drives_of(drive, found)
    goods, predictions, steps, lacks, taken = [], [], [], [], []
    fitted = fit.recordings[0].unit if isinstance(fit, Fit) else ""
    judgement = fit.judgement if isinstance(fit, Fit) else DEFAULT
    for recording, waveform, name in zip(found, drives, names, strict=True):
        measured = channel(recording, fit.observed, name)
        unit = str(recording[fit.observed].attrs.get("units", ""))
        if unit and fitted and unit != fitted:
            raise RecordingError(f"{fit.observed} of {name} is in {unit}, but was in {fitted} for the fit")
        predicted = fit.predict(recording) if waveform is None else fit.predict(recording, waveform)
        if not np.all(np.isfinite(predicted)):
            raise RecordingError(f"the model cannot predict {fit.observed} [{unit}] of {name}")
        variables = {"measured": measured, "predicted": predicted, "residual": predicted - measured}
        goods.append(goodness(predicted - measured, measured, name, unit))
        time = recording["time"].values
        seen = SeenDrive.of(recording, waveform, own=fit.observed == "end_effector_position")
        known = known_noise(seen.recording, measured, seen.whole)
        lacks.append(lack_of_fit(predicted - measured, known, name, judgement=judgement))
        since = seen.recording["time"].values
        steps.append((net_step(since, measured, seen.repeats), net_step(since, predicted, seen.repeats)))
        taken += [f"drive of {name}: {seen.said}"] if seen.said else []
        predictions.append(make_recording(time, {k: (v, unit) for k, v in variables.items()}, title=name))
    left, seen = ([p[key].values for p in predictions] for key in ("residual", "measured"))
    doubts = fit.doubts if isinstance(fit, Fit) else ()
    remarks, unexplained = _unjudged(lacks, goods, seen, doubts)
    return Verification(
        fit.observed,
        goods[0].unit,
        tuple(goods),
        tuple(predictions),
        tuple(steps),
        tuple(lacks),
        (*remarks, *_said_offsets(goods, left)),
        tuple(unexplained),
        tuple(taken),
    )
