"""Study: modal models of a piezo mechanism from frequency responses, per amplitude, verified on other
drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate.result import Fit
from ..figures.frequency import Response
from ..figures.frequency import frequency_response as frequency_response_figure
from ..figures.identification import Estimates, parameter_intervals
from ..figures.style import svg
from ..identify.frequency.in_time import identify_in_time
from ..identify.frequency.modal import identify_frequency, modal_response, steady_response
from ..identify.frequency.response import frequency_response
from ..input_file import Hertz, Strict
from ..parameters import cite
from ..progress import Progress
from ..report import Column, Document, Number, Picture, Section, Table
from ..report.fits import estimates, fit_numbers, parameter_table
from .file import SourceFile, Study, StudyError

_TWO_PI = 2.0 * np.pi


class Level(Strict):
    """One amplitude of the drive: arrays of shape (samples of a period, channels, realisations, periods)."""

    name: str
    amplitude: float
    drive: SourceFile
    response: SourceFile


class FrequencyStudy(Study):
    """See the module.

    `modes` are the models: for each its starts, as pairs of frequency [Hz] and damping ratio. The last
    `held_out` realisations verify; `output` counts from 1; of the excited lines, each `every`-th is fitted;
    `follow` are the modes, counted from 1 in the last model, whose change with the amplitude is shown;
    `time_domain` names levels for a fit in time as well; `tied` are poles of the last model that follow from
    others, as for `identify_frequency`.
    """

    kind: Literal["frequency_response"]
    sample_rate: Hertz
    units: tuple[str, str] = ("V", "m")
    band: tuple[Hertz, Hertz]
    output: int = 1
    held_out: int = 1
    every: int = 1
    modes: list[list[tuple[float, float]]]
    follow: list[int]
    tied: dict[str, str] = {}  # noqa: RUF012  # pydantic copies it
    time_domain: list[str] = []  # noqa: RUF012  # pydantic copies it
    levels: list[Level]

    def run(self, folder: Path, progress: Progress) -> Document:
        """Estimate, fit and verify at every level."""
        results = []
        for i, level in enumerate(self.levels):
            progress(f"fitting the response at {level.name}", i / len(self.levels))
            results.append(self._fit(level, folder))
        return _document(self, results)

    def _fit(self, level: Level, folder: Path) -> _Level:
        drive, response = (_array(source, folder) for source in (level.drive, level.response))
        seen, unseen = slice(None, -self.held_out), slice(-self.held_out, None)
        measured = frequency_response(
            drive[:, :, seen], response[:, :, seen], self.sample_rate, band=self.band, units=self.units
        ).isel(output=slice(self.output - 1, self.output), frequency=slice(None, None, self.every))
        fits = [identify_frequency(measured, modes) for modes in self.modes[:-1]]
        fits.append(identify_frequency(measured, self.modes[-1], tied=self.tied))
        # The mean over the periods, without the offset of the sensor: the steady state that the model has.
        steady = response[:, self.output - 1, unseen].mean(axis=2)
        steady = steady - steady.mean(axis=0)
        scores = []
        for fit in fits:
            predicted = steady_response(fit.model, drive[:, :, unseen].mean(axis=3), self.sample_rate)[:, 0]
            residual = predicted - predicted.mean(axis=0) - steady
            scores.append(
                (1.0 - np.sum(residual**2) / np.sum(steady**2), float(np.sqrt(np.mean(residual**2))))
            )
        in_time = None
        if level.name in self.time_domain:
            one = response[:, self.output - 1 : self.output, :1].mean(axis=3)
            in_time = identify_in_time(
                drive[:, :, :1].mean(axis=3),
                one - one.mean(axis=0),
                self.sample_rate,
                fits[-1].model,
                periodic=True,
                tied={name: text for name, text in self.tied.items() if name != "delay"},
            )
        return _Level(level, measured, fits, scores, in_time)


class _Level(NamedTuple):
    level: Level
    measured: xr.Dataset
    fits: list[Fit]
    scores: list[tuple[float, float]]  # r² and rms error on what was held out
    in_time: Fit | None


def _array(source: SourceFile, folder: Path) -> NDArray[np.float64]:
    path = source.path(folder)
    try:
        array = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: {error}") from error
    if array.ndim != 4:
        raise StudyError(
            f"{path} has the shape {array.shape}, not (samples, channels, realisations, periods)"
        )
    return array


def _static_gain(fit: Fit) -> Number:
    """Response by drive at low frequency, first input: the sum of all gains and of the remainder."""
    names = [p.name for p in fit.parameters if p.name.startswith("gain_") and p.name.endswith("[1,1]")]
    names += [p.name for p in fit.parameters if p.name == "remainder[1,1]"]
    value, error = fit.derived(lambda values: sum(values[name] for name in names))
    return Number(value, "m/V", low=value - 1.96 * error, high=value + 1.96 * error, standard_error=error)


def _mode(fit: Fit, m: int) -> tuple[Number, Number]:
    numbers = estimates(fit)
    omega = numbers[f"natural_frequency_{m}"]
    frequency = Number(
        omega.value / _TWO_PI,
        "Hz",
        low=None if omega.low is None else omega.low / _TWO_PI,
        high=None if omega.high is None else omega.high / _TWO_PI,
    )
    return frequency, numbers[f"damping_ratio_{m}"]


def _estimates(numbers: list[Number]) -> Estimates:
    ends = [[np.nan if end is None else end for end in (n.low, n.high)] for n in numbers]
    low, high = np.transpose(ends)
    return Estimates([n.value for n in numbers], low, high, numbers[0].unit)


def _document(study: FrequencyStudy, results: list[_Level]) -> Document:
    followed = _followed(study, results)
    best = [r.scores[-1][0] for r in results]
    gains = followed["static gain"]
    change = 100.0 * (gains[-1].value / gains[0].value - 1.0)
    return Document(
        title=study.title,
        summary=(
            f"{len(study.modes[-1])} modes predict held-out drives with r² of {min(best):.4f} or more at "
            f"every level. From {results[0].level.name} to {results[-1].level.name} the static gain grows by "
            f"{change:.1f} %."
        ),
        sections=[
            _prediction_section(study, results),
            _amplitude_section(study, results, followed),
            *(_in_time_section(study, r, r.in_time) for r in results if r.in_time is not None),
            Section(
                "All parameters",
                tables=[
                    parameter_table(f"{r.level.name}: identified parameters.", r.fits[-1]) for r in results
                ],
            ),
        ],
        highlights=(
            ("r² of held-out drives, least of all levels", Number(min(best), "")),
            (f"static gain at {results[0].level.name}", gains[0]),
        ),
        numbers={
            r.level.name: {
                "static_gain": gain,
                "r_squared_held_out": {
                    f"{len(m)}_modes": Number(s[0], "") for m, s in zip(study.modes, r.scores, strict=True)
                },
                **fit_numbers(r.fits[-1], "m/V"),
            }
            for r, gain in zip(results, gains, strict=True)
        },
        citations=cite(*study.citation) if study.citation else "",
    )


def _followed(study: FrequencyStudy, results: list[_Level]) -> dict[str, list[Number]]:
    """What is shown over the amplitude, level by level: static gain, frequencies and damping ratios."""
    followed: dict[str, list[Number]] = {"static gain": [_static_gain(r.fits[-1]) for r in results]}
    for m in study.follow:
        pairs = [_mode(r.fits[-1], m) for r in results]
        about = f"{np.mean([f.value for f, _ in pairs]):.0f} Hz"
        followed[f"mode near {about}"] = [f for f, _ in pairs]
        followed[f"damping ratio near {about}"] = [z for _, z in pairs]
    return followed


def _prediction_section(study: FrequencyStudy, results: list[_Level]) -> Section:
    """How well each model predicts what was held out, and the responses under the last one."""
    scores = [
        (r.level.name, f"{len(modes)}", *score)
        for r in results
        for modes, score in zip(study.modes, r.scores, strict=True)
    ]
    frequency = results[0].measured["frequency"].values
    show = slice(None, None, max(1, frequency.size // 1500))
    return Section(
        "Model order and prediction",
        paragraphs=(study.notes,) if study.notes else (),
        tables=[
            Table(
                "Prediction of held-out realisations (other drives than in the fit, on all inputs).",
                (Column("level"), Column("modes"), Column("r²", "", 5), Column("rms error", "m", 3)),
                scores,
            )
        ],
        figures=(
            Picture(
                "frequency_response",
                f"Response of output {study.output} to input 1: measured, and the model of "
                f"{len(study.modes[-1])} modes.",
                svg(
                    frequency_response_figure(
                        {r.level.name: _measured(r, frequency, show) for r in results},
                        {r.level.name: _modelled(r, frequency, show) for r in results},
                        unit="m/V",
                    )
                ),
                "Gain and phase over frequency at each level, measured and modelled; residuals below",
            ),
        ),
    )


def _amplitude_section(
    study: FrequencyStudy, results: list[_Level], followed: dict[str, list[Number]]
) -> Section:
    """What changes with the amplitude."""
    return Section(
        "Change with the amplitude",
        tables=[
            Table(
                f"What changes with the amplitude ({len(study.modes[-1])} modes); 95 % confidence intervals.",
                (Column("quantity"), *(Column(r.level.name) for r in results)),
                [(name, *numbers) for name, numbers in followed.items()],
            )
        ],
        figures=(
            Picture(
                "amplitude_dependence",
                "Static gain, frequencies and damping ratios over the amplitude of the drive.",
                svg(
                    parameter_intervals(
                        [r.level.amplitude for r in results],
                        {name: _estimates(numbers) for name, numbers in followed.items()},
                        setting_name="rms drive",
                        setting_unit=study.units[0],
                    )
                ),
                "One panel for each quantity, values with confidence intervals over the drive",
            ),
        ),
    )


def _in_time_section(study: FrequencyStudy, r: _Level, in_time: Fit) -> Section:
    """The modes of a level beside those that were fitted in time."""
    columns = ("frequency, by response", "damping, by response", "frequency, in time", "damping, in time")
    return Section(
        f"The same modes fitted in time, {r.level.name}",
        paragraphs=(
            "Free simulation of one period of the steady state. Its residuals are correlated, "
            f"so its intervals are too narrow; r² of that fit is {in_time.r_squared:.4f}.",
        ),
        tables=(
            Table(
                "Two ways to the same modes.",
                (Column("mode"), *(Column(c) for c in columns)),
                [
                    (f"mode {m}", *_mode(r.fits[-1], m), *_mode(in_time, m))
                    for m in range(1, len(study.modes[-1]) + 1)
                ],
            ),
        ),
    )


def _measured(r: _Level, frequency: NDArray[np.float64], show: slice) -> Response:
    one: Any = r.measured.isel(output=0, input=0)
    return Response(frequency[show], one["response"].values[show], one["deviation"].values[show])


def _modelled(r: _Level, frequency: NDArray[np.float64], show: slice) -> Response:
    return Response(frequency[show], modal_response(r.fits[-1].model, frequency[show])[:, 0, 0])
