"""An actuator from the numbers of its data sheet, with a posterior of what the sheet leaves open."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate.posterior import Posterior
from ..estimate.problem import FitError
from ..estimate.shown import preformatted
from ..estimate.tempering import sample_tempered
from ..parameters.writing import parameter_text
from ..physics.actuator import Actuator
from ..quantities.progress import Progress, unheard
from ..quantities.records import whole
from ..quantities.units import QuantityError, to_si, with_prefix
from ..recording.replacing import replaced_whole
from ..waveform import Sawtooth
from .data_sheet import DataSheet, load_data_sheet
from .plan import Plan
from .planning import plan_experiment
from .sheet_density import Simulated, actuator_of
from .sheet_priors import NAMES, SHEET, UNITS, Expectations, expectations

Array = NDArray[np.float64]

# Parameters of the posterior and their SI units.
COLUMNS = UNITS | {"stiction_force": "N"}
# Number of draws that are simulated for the intervals of the sheet's numbers.
CHECKED = 200
# Start of the source of an assumed number of a sheet, before the reason; as `load_data_sheet` has it.
ASSUMED = "assumed: "
# Largest width of a parameter's interval, divided by that of its prior (both in the logarithm), at which the
# sheet determines the parameter.
TOLD = 0.5
# Number of drive periods in a planned recording, and number of samples per period.
PERIODS, SAMPLES = 40, 200
# Approximate number of draws of the posterior for which a plan is made.
PLANNED = 4
# Standard deviation of a position sample, divided by the net step, if the user gives no noise to `plan`.
NOISE_SHARE = 0.01


@dataclass(frozen=True, eq=False, repr=False)
class SheetModel:
    """Result of `from_data_sheet`: an actuator with a posterior of its parameters.

    Attributes:
        sheet: the given numbers.
        model: the actuator of the most probable draw.
        posterior: draws of all parameters, as `fit`, `uncertainty`, `draws` or `posterior` of `step_map`,
            `optimise_waveform`, `plan_experiment`, `control.tune` and others.
        dataset: over "parameter": value (of the model), low and high (95 %), expected_low and expected_high
            (95 % before the sheet was used), reason (of the expectation), and width. The width is the log
            ratio of the interval's ends over the same ratio of the expected interval. Over "quantity", the
            sheet's numbers that follow from a simulation: stated (by the sheet), of_model, predicted (median
            of the draws), predicted_low and predicted_high (95 %).
        drive: sawtooth over the whole voltage range, at the rate of the sheet's step.
        speed_rate: step rate of the sheet's speed, Hz; 0 if the sheet gives neither a speed nor its rate.
        sources: source of each number, by name; "assumed: " and the reason for an assumed number. Without a
            `max_voltage` of the sheet, 100 V above its `min_voltage` are assumed: this comes first, and the
            gain and its interval are valid for this voltage only.
        citations: keys of the references.
    """

    sheet: DataSheet
    model: Actuator
    posterior: Posterior
    dataset: xr.Dataset
    drive: Sawtooth
    speed_rate: float
    sources: Mapping[str, str]
    citations: tuple[str, ...]

    @property
    def determined(self) -> tuple[str, ...]:
        """Return the names of the parameters that the sheet prints, or determines otherwise: the interval is
        narrower than half the expected one (`width` in `dataset` below 0.5). If `max_voltage` is assumed, the
        gain is not determined."""
        of = self.dataset
        told = (of["reason"].values == SHEET) | (of["width"].values < TOLD)
        return tuple(name for name in of["parameter"].values[told].tolist() if name not in self._on_voltage)

    @property
    def assumptions(self) -> dict[str, str]:
        """Return the reason of each assumed number of the sheet (`sources`), by name, the voltage first."""
        names = sorted(self.sources, key=lambda name: name != "max_voltage")
        said = {name: self.sources[name] for name in names}
        return {name: one.removeprefix(ASSUMED) for name, one in said.items() if one.startswith(ASSUMED)}

    @property
    def _on_voltage(self) -> tuple[str, ...]:
        """Return the names of the parameters that are valid for an assumed voltage only."""
        return ("gain",) if "max_voltage" in self.assumptions else ()

    @property
    def open(self) -> tuple[str, ...]:
        """Return the names of the parameters that the sheet does not determine."""
        known = self.determined
        return tuple(name for name in NAMES if name not in known)

    @property
    def citation(self) -> str:
        """Return a text with the sheet's title, and a line with the source of each number."""
        return "\n".join([self.sheet.title, *(f"  {name}: {said}" for name, said in self.sources.items())])

    _repr_html_ = preformatted

    def __repr__(self) -> str:
        return self.report()

    def report(self) -> str:
        """Return a text with tables of the sheet's numbers and of the parameters, and the names of the
        parameters that the sheet leaves open."""
        of, lines = self.dataset, [f"{self.sheet.title}", ""]
        assumed = [f"Assumed {name}: {reason}." for name, reason in self.assumptions.items()]
        lines += [*assumed, ""] if assumed else []
        lines.append(f"{'data sheet':14}{'stated':>12}{'model':>12}   95 % of the draws")
        for name in of["quantity"].values.tolist():
            row = of.sel(quantity=name)
            unit = str(row["quantity_unit"].values)
            shown = [
                with_prefix(float(row[one]), unit, 4)
                for one in ("stated", "of_model", "predicted_low", "predicted_high")
            ]
            lines.append(f"{name:14}{shown[0]:>12}{shown[1]:>12}   {shown[2]} to {shown[3]}")
        lines += ["", f"{'parameter':18}{'value':>15}   {'95 % interval':36}determined by"]
        for name in of["parameter"].values.tolist():
            row = of.sel(parameter=name)
            unit = str(row["parameter_unit"].values)
            value, low, high = (with_prefix(float(row[one]), unit, 3) for one in ("value", "low", "high"))
            lines.append(
                f"{name:18}{value:>15}   {f'{low} to {high}':36}{_by(row, name in self._on_voltage)}"
            )
        left = ", ".join(self.open) or "nothing"
        return "\n".join([*lines, "", f"The sheet leaves open: {left}.", self.posterior.message])

    def plan(self, *, noise: float | str | None = None, **options: Any) -> Plan:
        """Choose the recordings that would determine the parameters that the sheet leaves open, except
        masses, by `plan_experiment`; return the plan.

        Args:
            noise: standard deviation of a sample of the position, m; by default a hundredth of the step.
            options: further arguments of `plan_experiment`; free, duration, sample_rate, draws and default
                have their own default values here.

        Raises:
            QuantityError: the sheet leaves no such parameter open, or as `plan_experiment`.
        """
        step = self.sheet.step or self.model.gain * self.drive.amplitude
        given = {
            "free": [name for name in self.open if name not in ("stage_mass", "end_effector_mass")],
            "duration": PERIODS / self.drive.frequency,
            "sample_rate": SAMPLES * self.drive.frequency,
            "draws": {name: one[:: max(1, one.size // PLANNED)] for name, one in self._draws().items()},
            "default": self.drive,
        }
        if not (given | options)["free"]:
            raise QuantityError("the data sheet leaves nothing open that a walk determines: nothing to plan")
        return plan_experiment(
            self.model,
            noise=NOISE_SHARE * step if noise is None else to_si(noise, "m", "noise"),
            **(given | options),
        )

    def _draws(self) -> dict[str, Array]:
        return {name: self.posterior.samples[name].values.ravel() for name in COLUMNS}

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write model.toml (`load_actuator` reads it) and posterior.nc (`uncertainty` of a design file) into
        a folder, which is made if necessary; return its path. Existing files are replaced.

        Raises:
            OSError: the folder cannot be written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        source = f"the most probable draw for the data sheet {self.sheet.title}"
        with replaced_whole(folder / "model.toml") as temporary:
            text = parameter_text(self.model, self.sheet.title, source, assumed=self.assumptions)
            temporary.write_text(text, encoding="utf-8")
        with replaced_whole(folder / "posterior.nc") as temporary:
            self.posterior.samples.to_netcdf(temporary, engine="h5netcdf")
        return folder


def _by(row: xr.Dataset, assumed: bool) -> str:
    reason = str(row["reason"].values)
    if assumed:
        return f"assumption: {'printed stroke over an assumed voltage' if reason == SHEET else reason}"
    if reason == SHEET:
        return "the sheet prints it"
    width = float(row["width"])
    if width < TOLD:
        return f"the sheet, {1.0 / width:.1f} times narrower than expected"
    return f"assumption: {reason}"


def from_data_sheet(
    sheet: DataSheet | str | os.PathLike[str] | None = None,
    *,
    draws: int = 960,
    seed: int = 0,
    progress: Progress = unheard,
    **numbers: float | str | None,
) -> SheetModel:
    """Return an actuator that reproduces a data sheet, and a posterior of what the sheet leaves open.

    ``from_data_sheet(step="1 um", speed="2 mm/s", stall_force="1 N", max_voltage=100, mass="20 g")``. The
    friction is a `LuGre` law without Stribeck effect. The sheet's step is the step under a slow sawtooth over
    all voltages with a jump. Its speed is the speed under the same sawtooth at the sheet's step rate. Its
    stall force is the load at which the step is zero. Without `max_voltage`, a range of 100 V is assumed; the
    gain is then not determined (`assumptions` of the result). Parameters that no number of the sheet
    determines follow from assumptions with wide factors (`reason` in `dataset`).

    Args:
        sheet: the name of a sheet that comes with the package (`design.available_data_sheets`), a TOML file,
            or a `design.DataSheet`; by default the numbers are given by keyword.
        draws: number of draws of the posterior; the number of simulations grows in proportion.
        seed: seed of the draws.
        progress: called with the current activity and the finished fraction, from 0 to 1.
        numbers: fields of `design.DataSheet` by name, in SI or as strings with units: travel, step, speed,
            stall_force, resonance, capacitance, max_voltage, mass, min_voltage, frequency, step_frequency,
            stroke, holding_force, stiffness, blocking_force, current, tolerance, title. They replace numbers
            of the sheet.

    Raises:
        QuantityError: a number is out of range, the sheet contradicts itself, or does not determine the step.
        FitError: no actuator that was tried reproduces the sheet, or the package arviz is not installed.
        ParameterSetError: see `design.load_data_sheet`.
    """
    sources: Mapping[str, str] = {}
    citations: tuple[str, ...] = ()
    if isinstance(sheet, str | os.PathLike):
        found = load_data_sheet(sheet)
        sheet, citations, sources = found
    if sheet is not None and not isinstance(sheet, DataSheet):
        raise QuantityError(f"sheet = {sheet!r:.60} must be a design.DataSheet, a name or a TOML file")
    given: dict[str, Any] = dict(numbers)
    of = DataSheet(**given) if sheet is None else sheet._replace(**given)
    sources = {name: sources.get(name, "given") if name not in numbers else "given" for name in of.numbers}
    expected = expectations(of)
    if of.max_voltage is None:
        reason = (
            f"{expected.high:g} V, for the sheet prints no greatest voltage; the gain goes as its inverse"
        )
        sources = {"max_voltage": f"{ASSUMED}{reason}"} | sources
    simulated = Simulated.of(of, expected)
    try:
        posterior = sample_tempered(
            simulated.log_likelihood,
            len(NAMES),
            _columns_of(expected),
            list(COLUMNS.items()),
            draws=whole(draws, "draws", 100, 100_000),
            seed=seed,
            progress=progress,
        )
    except FitError as error:
        if "arviz" in str(error):
            raise
        raise FitError(
            "no actuator that was tried reproduces the data sheet: its numbers do not fit a stick-slip "
            "actuator with a sawtooth drive; check frequency, mass and stall_force"
        ) from error
    model = _most_probable(posterior, simulated)
    dataset = _dataset(simulated, posterior, model, np.random.default_rng([seed, 1]))
    return SheetModel(
        of, model, posterior, dataset, simulated.drive, simulated.speed_rate, sources, citations
    )


def _columns_of(expected: Expectations) -> Callable[[Array], dict[str, Array]]:
    """Return a function that converts coordinates [n, k] to the parameters in `COLUMNS` by name, arrays [n],
    SI.

    The coordinates have a standard normal distribution in the prior. The stiction force equals the Coulomb
    force.
    """

    def columns(points: Array) -> dict[str, Array]:
        values = expected.values(points)
        return values | {"stiction_force": values["coulomb_force"]}

    return columns


def _most_probable(posterior: Posterior, simulated: Simulated) -> Actuator:
    samples = posterior.samples
    at = int(np.argmax(samples["log_posterior"].values.ravel()))
    values = {name: float(samples[name].values.ravel()[at]) for name in NAMES}
    return actuator_of(values, simulated.expected)


def _dataset(
    simulated: Simulated, posterior: Posterior, model: Actuator, random: np.random.Generator
) -> xr.Dataset:
    draws = {name: posterior.samples[name].values.ravel() for name in NAMES}
    of_model = {name: np.array([_value(model, name)]) for name in NAMES}
    before = simulated.expected.values(random.standard_normal((20_000, len(NAMES))))
    ends = [0.025, 0.975]
    low, high = np.array([np.quantile(draws[name], ends) for name in NAMES]).T
    expected_low, expected_high = np.array([np.quantile(before[name], ends) for name in NAMES]).T
    some = random.integers(0, draws["gain"].size, CHECKED)
    predicted = simulated.predicted({name: one[some] for name, one in draws.items()})
    exact = simulated.predicted(of_model)
    names = [one.name for one in simulated.data]
    about = simulated.expected.known
    quantity, parameter = ("quantity",), ("parameter",)
    return xr.Dataset(
        {
            "value": (parameter, [float(of_model[name][0]) for name in NAMES]),
            "low": (parameter, low),
            "high": (parameter, high),
            "expected_low": (parameter, expected_low),
            "expected_high": (parameter, expected_high),
            "width": (parameter, np.log(high / low) / np.log(expected_high / expected_low)),
            "reason": (parameter, [about[name].reason for name in NAMES]),
            "stated": (quantity, [one.value for one in simulated.data]),
            "of_model": (quantity, [float(exact[name][0]) for name in names]),
            "predicted": (quantity, [float(np.nanmedian(predicted[name])) for name in names]),
            "predicted_low": (quantity, [float(np.nanquantile(predicted[name], 0.025)) for name in names]),
            "predicted_high": (quantity, [float(np.nanquantile(predicted[name], 0.975)) for name in names]),
        },
        coords={
            "parameter": list(NAMES),
            "parameter_unit": (parameter, [UNITS[name] for name in NAMES]),
            "quantity": names,
            "quantity_unit": (quantity, [one.unit for one in simulated.data]),
        },
        attrs={"title": simulated.sheet.title},
    )


def _value(model: Actuator, name: str) -> float:
    return float(getattr(model.friction if name in model.friction._fields else model, name))
