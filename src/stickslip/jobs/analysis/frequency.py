"""Analysis of frequency responses: modal models of a piezo mechanism, verified on other drives.

A model consists of vibration modes, a delay, and a remainder for faster modes. There is a model for each
amplitude of the drive (level) and, if requested, one for all amplitudes.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ...estimate.result import Fit
from ...identify.frequency.in_time import identify_in_time
from ...identify.frequency.modal import ModalModel, identify_frequency, modal_response, steady_response
from ...identify.frequency.response import frequency_response, ratio_of
from ...parameters import cite
from ...quantities.input_file import Hertz
from ...quantities.progress import Progress, within
from ...recording.conversion import is_unit, to_si_unit
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.frequency import Response
from ...report.figures.frequency import frequency_response as frequency_response_figure
from ...report.figures.identification import Estimates, parameter_intervals
from ...report.figures.style import svg
from ...report.fits import estimates, parameter_table
from .all_levels import LevelData, OneModel, numbers_of, one_model_section, score
from .arrays import Arrays, check_test
from .file import Analysis, AnalysisError
from .modes import Modes, Outputs, Starts, count, refused, started

_TWO_PI = 2.0 * np.pi


class Level(Arrays):
    """Data of one amplitude of the drive (level).

    `amplitude` is the rms drive, in the drive's unit, for the axis of figures. `test` are files for
    verification, used instead of the last realisations of `drive` and `response`.
    """

    name: str
    amplitude: float
    test: Arrays | None = None


class FrequencyAnalysis(Analysis):
    """Request to fit modal models to frequency responses.

    `units` are those of drive and response. `modes` lists the models, each as a number of modes or as initial
    values: pairs of frequency [Hz] and damping ratio. For a number, the modes are first identified at the
    level of middle amplitude; all levels start from the result. `band` are the lowest and highest fitted
    frequency [Hz]. The last `held_out` realisations of a level without files to `test` are not fitted, but
    predicted (one by default). `output` counts from 1 and may be a list. Every `every`-th excited frequency
    is fitted, weighted by its deviation or equally (`equal_weights`). `follow` are modes, counted from 1 in
    the last model, whose change with the amplitude is shown. `one_model` fits the last model to all levels
    together, as `identify_levels`. `time_domain` names levels that are also fitted in the time domain. `tied`
    are poles of the last model that follow from others, as for `identify_frequency`.
    """

    kind: Literal["frequency_response"]
    sample_rate: Hertz
    units: tuple[str, str] = ("V", "m")
    band: tuple[Hertz, Hertz]
    output: Outputs = (1,)
    held_out: Annotated[int, Field(ge=1)] | None = None
    every: Annotated[int, Field(ge=1)] = 1
    equal_weights: bool = False
    modes: Annotated[list[Modes], Field(min_length=1)]
    follow: list[Annotated[int, Field(ge=1)]] = []  # noqa: RUF012  # pydantic copies the default
    one_model: bool = False
    tied: dict[str, str] = {}  # noqa: RUF012  # pydantic copies the default
    time_domain: list[str] = []  # noqa: RUF012  # pydantic copies the default
    levels: Annotated[list[Level], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits_together(self) -> FrequencyAnalysis:
        for unit in self.units:
            if not is_unit(unit):
                raise refused(f"'units' has {unit!r}, which is not known here")
        n_modes = [count(modes) for modes in self.modes]
        if any(m > n_modes[-1] for m in self.follow):
            raise refused(f"'follow' has {max(self.follow)}, but the last model has {n_modes[-1]} modes")
        if self.held_out and all(level.test for level in self.levels):
            raise refused("give either 'held_out' or the files to 'test'")
        if self.one_model and len(self.levels) < 2:
            raise refused("'one_model' needs two levels or more")
        if self.one_model and self.tied:
            raise refused("'tied' is for models of single levels, not for 'one_model'")
        return self

    def run(self, folder: Path, progress: Progress) -> Document:
        """Estimate the frequency responses, fit and verify the models at every level; return the report."""
        share = 0.6 if self.one_model else 1.0
        read = [self._read(level, folder) for level in self.levels]
        progress("finding the modes", 0.0)
        by_drive = sorted(read, key=lambda data: float(data.measured["drive_rms"]))
        models = [started(by_drive[len(read) // 2].weighted, modes) for modes in self.modes]
        results = []
        for i, data in enumerate(read):
            progress(f"fitting the response at {data.level.name}", share * (i + 0.5) / len(read))
            results.append(self._fit(data, models))
        if not self.one_model:
            return _document(self, results, None)
        follow = partial(within, progress, share, 1.0 - share)
        tested = [LevelData(r.level.name, r.data.weighted, r.data.drive, r.data.steady) for r in results]
        scores = [r.scores[-1] for r in results]
        return _document(
            self, results, one_model_section(tested, scores, models[-1], self.sample_rate, follow)
        )

    @property
    def si_units(self) -> tuple[str, str]:
        """Return the SI units of drive and response, in which the analysis computes and reports."""
        drive, response = map(to_si_unit, self.units)
        return drive.unit, response.unit

    def _read(self, level: Level, folder: Path) -> _Data:
        """Return the data of a level: frequency response of its fitted realisations, and held-out data."""
        drive, response = level.in_si(folder, self.units)
        channels = [o - 1 for o in self.output]
        last = None if level.test else -(self.held_out or 1)
        measured = frequency_response(
            drive[:, :, :last], response[:, :, :last], self.sample_rate, band=self.band, units=self.si_units
        ).isel(frequency=slice(None, None, self.every))
        if max(self.output) > measured.sizes["output"]:
            path = level.response.path(folder)
            raise AnalysisError(f"{path}: output {max(self.output)}: it has {measured.sizes['output']}")
        measured = measured.isel(output=channels)
        unseen = drive[:, :, last:], response[:, :, last:]
        if level.test:
            unseen = level.test.in_si(folder, self.units)
            check_test(level.name, unseen, (drive.shape[1], response.shape[1]))
        # The steady state of a model has no offset; the measured one is freed of the sensor's offset.
        tested, steady = (array.mean(axis=3) for array in unseen)
        steady = steady[:, channels] - steady[:, channels].mean(axis=0)
        weighted = measured
        if self.equal_weights:
            alike = xr.full_like(measured["deviation"], float(measured["deviation"].mean()))
            weighted = measured.assign(deviation=alike)
        first = drive[:, :, :1].mean(axis=3), response[:, channels, :1].mean(axis=3)
        return _Data(level, measured, weighted, tested, steady, first)

    def _fit(self, data: _Data, models: list[Starts | ModalModel]) -> _Level:
        level = data.level
        fits = [identify_frequency(data.weighted, modes) for modes in models[:-1]]
        fits.append(identify_frequency(data.weighted, models[-1], tied=self.tied))
        scores = [
            score(steady_response(fit.model, data.drive, self.sample_rate), data.steady) for fit in fits
        ]
        in_time = None
        if level.name in self.time_domain:
            drive, one = data.first
            in_time = identify_in_time(
                drive,
                one - one.mean(axis=0),
                self.sample_rate,
                fits[-1].model,
                periodic=True,
                tied={name: text for name, text in self.tied.items() if name != "delay"},
            )
        return _Level(level, data, fits, scores, in_time)


class _Data(NamedTuple):
    """Data of one drive amplitude (level). Held-out data are means over the periods, for verification."""

    level: Level
    measured: xr.Dataset  # frequency response of the fitted realisations, with its deviation
    weighted: xr.Dataset  # the same response, with the deviations that weight the fit
    drive: NDArray[np.float64]  # held-out drives: (samples, inputs, realisations)
    steady: NDArray[np.float64]  # measured responses: (samples, outputs, realisations)
    first: tuple[NDArray[np.float64], NDArray[np.float64]]  # drive and response of the first realisation


class _Level(NamedTuple):
    level: Level
    data: _Data
    fits: list[Fit]
    scores: list[tuple[float, float]]  # r² and rms error on held-out data, by model
    in_time: Fit | None


def _static_gain(fit: Fit) -> Number:
    """Return the static gain from the first input to the first output, with its 95 % interval.

    It is the sum of the gains of all modes and of the remainder, which represents faster modes.
    """
    rest = next(p for p in fit.parameters if p.name.startswith("remainder"))
    channel = rest.name.removeprefix("remainder")
    names = [*(f"gain_{m}{channel}" for m in range(1, len(fit.model.gain) + 1)), rest.name]
    value, error = fit.derived(lambda values: sum(values[name] for name in names))
    return Number(value, rest.unit, low=value - 1.96 * error, high=value + 1.96 * error, standard_error=error)


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


def _document(analysis: FrequencyAnalysis, results: list[_Level], one: OneModel | None) -> Document:
    followed = _followed(analysis, results)
    best = [r.scores[-1][0] for r in results]
    gains = followed["static gain"]
    change = 100.0 * (gains[-1].value / gains[0].value - 1.0)
    return Document(
        title=analysis.title,
        summary=(
            f"{count(analysis.modes[-1])} modes predict held-out drives with r² of {min(best):.4f} or more "
            f"at every level. From {results[0].level.name} to {results[-1].level.name} the static gain grows "
            f"by {change:.1f} %." + (f" {one.summary}" if one else "")
        ),
        sections=[
            _prediction_section(analysis, results),
            _amplitude_section(analysis, results, followed),
            *([one.section] if one else []),
            *(_in_time_section(analysis, r, r.in_time) for r in results if r.in_time is not None),
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
                    f"{count(m)}_modes": Number(s[0], "")
                    for m, s in zip(analysis.modes, r.scores, strict=True)
                },
                **numbers_of(r.fits[-1]),
            }
            for r, gain in zip(results, gains, strict=True)
        }
        | ({"all_levels": one.numbers} if one else {}),
        citations=cite(*analysis.citation) if analysis.citation else "",
    )


def _followed(analysis: FrequencyAnalysis, results: list[_Level]) -> dict[str, list[Number]]:
    """Return the quantities that are shown over the amplitude, by name; each list has a number per level:
    static gain, and frequency [Hz] and damping ratio of the modes to `follow`."""
    followed: dict[str, list[Number]] = {"static gain": [_static_gain(r.fits[-1]) for r in results]}
    for m in analysis.follow:
        pairs = [_mode(r.fits[-1], m) for r in results]
        about = f"{np.mean([f.value for f, _ in pairs]):.0f} Hz"
        followed[f"mode near {about}"] = [f for f, _ in pairs]
        followed[f"damping ratio near {about}"] = [z for _, z in pairs]
    return followed


def _prediction_section(analysis: FrequencyAnalysis, results: list[_Level]) -> Section:
    """Return the section on predictions of held-out drives by each model, with a figure of the last model."""
    drive_unit, output_unit = analysis.si_units
    scores = [
        (r.level.name, f"{count(modes)}", *score)
        for r in results
        for modes, score in zip(analysis.modes, r.scores, strict=True)
    ]
    frequency = results[0].data.measured["frequency"].values
    show = slice(None, None, max(1, frequency.size // 1500))
    return Section(
        "Model order and prediction",
        paragraphs=(analysis.notes,) if analysis.notes else (),
        tables=[
            Table(
                "Prediction of held-out realisations (other drives than in the fit, on all inputs).",
                (Column("level"), Column("modes"), Column("r²", "", 5), Column("rms error", output_unit, 3)),
                scores,
            )
        ],
        figures=(
            Picture(
                "frequency_response",
                f"Response of output {analysis.output[0]} to input 1: measured, and the model of "
                f"{count(analysis.modes[-1])} modes.",
                svg(
                    frequency_response_figure(
                        {r.level.name: _measured(r, frequency, show) for r in results},
                        {r.level.name: _modelled(r, frequency, show) for r in results},
                        unit=ratio_of((drive_unit, output_unit)),
                    )
                ),
                "Gain and phase over frequency at each level, measured and modelled; residuals below",
            ),
        ),
    )


def _amplitude_section(
    analysis: FrequencyAnalysis, results: list[_Level], followed: dict[str, list[Number]]
) -> Section:
    """Return the section on the change of the `followed` quantities (see `_followed`) with the amplitude."""
    return Section(
        "Change with the amplitude",
        tables=[
            Table(
                f"What changes with the amplitude ({count(analysis.modes[-1])} modes); 95 % intervals.",
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
                        [r.level.amplitude * to_si_unit(analysis.units[0]).factor for r in results],
                        {name: _estimates(numbers) for name, numbers in followed.items()},
                        setting_name="rms drive",
                        setting_unit=analysis.si_units[0],
                    )
                ),
                "One panel for each quantity, values with confidence intervals over the drive",
            ),
        ),
    )


def _in_time_section(analysis: FrequencyAnalysis, r: _Level, in_time: Fit) -> Section:
    """Return the section that compares the modes of a level, `r`, with `in_time`, a fit in the time
    domain."""
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
                    for m in range(1, count(analysis.modes[-1]) + 1)
                ],
            ),
        ),
    )


def _measured(r: _Level, frequency: NDArray[np.float64], show: slice) -> Response:
    one: Any = r.data.measured.isel(output=0, input=0)
    return Response(frequency[show], one["response"].values[show], one["deviation"].values[show])


def _modelled(r: _Level, frequency: NDArray[np.float64], show: slice) -> Response:
    return Response(frequency[show], modal_response(r.fits[-1].model, frequency[show])[:, 0, 0])
