"""Common fields of the parts of a design file: model, uncertainty, goals, limits, generator, conditions."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from ...design import Current, Heat, Noise, Scenario, Speed, StepSize, TipLoad, optimise_waveform
from ...gate.errors import GateError, damaged
from ...gate.netcdf import netcdf_columns
from ...gate.results import results_numbers
from ...physics.actuator import Actuator
from ...physics.electronics import OutputStage, Stack
from ...quantities.arguments import arguments_of
from ...quantities.input_file import Part, Strict, fields_of
from ...quantities.progress import Progress
from ...quantities.units import QuantityError, to_si
from ...rig import load_bench
from ...rig.experiment.laboratory import own_file
from .file import AnalysisError

Quantity = float | str
Array = NDArray[np.float64]
# Draws from the intervals of a results.json; each part uses as many of them as it needs.
DRAWS = 1000


class Given(NamedTuple):
    """Inputs of a part: model, draws of its parameters (None without uncertainty), the file's folder."""

    model: Actuator
    uncertainty: dict[str, Array] | None
    folder: Path
    progress: Progress


class GoalSpec(Strict):
    """A goal of a search, with exactly one number.

    The number is the direction of the speed (1 or -1), the required step [m], the capacitance for the current
    [F], or the piezo stack for the heat.
    """

    speed: Quantity | None = None
    step: Quantity | None = None
    current: Quantity | None = None
    heat: Part[Stack] | None = None

    @model_validator(mode="after")
    def _one(self) -> GoalSpec:
        if len(self.model_fields_set) != 1:
            raise ValueError(f"a goal is exactly one of {', '.join(GoalSpec.model_fields)}")
        return self

    def goal(self) -> Any:
        """Return the goal as a record of `design`; raise QuantityError for a wrong value."""
        if self.heat is not None:
            return Heat(self.heat)
        ((name, value),) = self.model_dump(exclude_unset=True).items()
        kinds: dict[str, Any] = {"speed": Speed, "step": StepSize, "current": Current}
        return kinds[name](value)


Goal = GoalSpec | str


def goal_of(given: Goal | None, model: Actuator) -> Any:
    """Return a goal of a file as the searches take it; raise QuantityError for a wrong value."""
    if isinstance(given, GoalSpec):
        return given.goal()
    if given in ("tip_load", "noise"):
        return (TipLoad if given == "tip_load" else Noise).of_stage(model)
    return given


class OutputLimitsSpec(fields_of(OutputStage, "slew_rate", "current", "capacitance")):
    """Limits of an `OutputStage`, or the amplifier of a `bench` with its piezo as load."""

    bench: str | None = None

    def output(self, folder: Path) -> OutputStage:
        """Return the output stage with these limits; raise QuantityError for a wrong value."""
        if self.bench is None:
            return OutputStage(**self.given)
        if self.given:
            raise QuantityError(f"limits.{next(iter(self.given))} is that of limits.bench: give one of them")
        bench = load_bench(own_file(self.bench, folder, ".toml"))
        return OutputStage.of_amplifier(bench.amplifier, bench.piezo_capacitance)


class GeneratorSpec(fields_of(OutputStage, "update_rate", "points", "step", "interpolation")):
    """Converter of an `OutputStage`, or the converter of a `bench` with a number of `points`."""

    bench: str | None = None

    def onto(self, output: OutputStage, folder: Path) -> OutputStage:
        """Return an output stage with this converter; raise QuantityError for a wrong value."""
        given = self.given
        if self.bench is None:
            if "update_rate" not in given:
                raise QuantityError("generator.update_rate [Hz] is missing, or generator.bench")
            return output.with_converter(OutputStage(**given))
        points = given.pop("points", None)
        if given or points is None:
            raise QuantityError(
                f"generator.{next(iter(given))} is that of generator.bench: give one of them"
                if given
                else "generator.points is missing: how many points of a period the generator takes"
            )
        bench = load_bench(own_file(self.bench, folder, ".toml"))
        return output.with_converter(bench.output(points))


def output_stage(
    limits: OutputLimitsSpec | None, generator: GeneratorSpec | None, folder: Path
) -> OutputStage:
    """Return the output stage of limits and a generator; raise QuantityError for a wrong value."""
    output = OutputStage() if limits is None else limits.output(folder)
    return output if generator is None else generator.onto(output, folder)


class ScenarioSpec(Strict):
    """A condition: `change` sets fields of the actuator or its law, `factors` multiply their values."""

    name: str = ""
    change: dict[str, Quantity] = Field(default_factory=dict)
    factors: dict[str, Quantity] = Field(default_factory=dict)

    def scenario(self) -> Scenario:
        """Return the condition as a `Scenario`; raise QuantityError for a wrong value."""
        factors = {name: to_si(one, "", f"factors.{name}") for name, one in self.factors.items()}
        return Scenario(self.name, factors=factors, **self.change)


class SearchSpec(arguments_of(optimise_waveform, "max_voltage", "min_voltage", "frequency", "seed")):
    """Common arguments of all searches for a drive; see `optimise_waveform`."""

    limits: OutputLimitsSpec | None = None
    scenarios: list[ScenarioSpec] = Field(default_factory=list)

    def common(self, given: Given) -> dict[str, Any]:
        """Return the arguments that all searches for a drive have in common; raise QuantityError for wrong
        values."""
        return {
            **self.arguments,
            "output": output_stage(self.limits, None, given.folder),
            "scenarios": [one.scenario() for one in self.scenarios],
            "progress": given.progress,
        }


def draws_of_file(path: Path) -> dict[str, Array]:
    """Return draws of an actuator's parameters, by name.

    They are the samples of a posterior (NetCDF), or `DRAWS` draws from the estimates of an identification or
    a campaign (results.json), log-normal for positive parameters and normal for others.

    Raises:
        AnalysisError: the file contains neither.
    """
    if path.suffix == ".json":
        return _drawn(path)
    try:
        found = netcdf_columns(path)
    except GateError as error:
        said = str(error).removeprefix(f"{path}: ")
        raise AnalysisError(f"{path}: no samples of a posterior: {said}") from error
    return {name: values for name, values in found.items() if name != "log_posterior"}


def _drawn(path: Path) -> dict[str, Array]:
    with damaged(AnalysisError, f"{path}: no results of an identification that says how sure it is"):
        numbers = results_numbers(path)
        parts = [numbers[part] for part in ("friction", "stage") if part in numbers] or [numbers]
        random, found = np.random.default_rng(0), dict[str, Array]()
        for part in parts:
            names = part["correlation"]["parameters"]
            known = part.get("parameters_with_all_errors", part["parameters"])
            value, error = (
                np.array([known[name][of] for name in names], float) for of in ("value", "standard_error")
            )
            known_ones = np.flatnonzero(np.isfinite(error))
            positive = value[known_ones] > 0.0
            scale = np.where(positive, value[known_ones], 1.0)
            relative = error[known_ones] / scale
            correlation = np.array(part["correlation"]["coefficients"]["value"], float)
            spread = np.outer(relative, relative) * np.nan_to_num(correlation[np.ix_(known_ones, known_ones)])
            np.fill_diagonal(spread, relative**2)
            q = random.multivariate_normal(np.zeros(known_ones.size), spread, DRAWS, method="eigh")
            drawn = np.where(positive, scale * np.exp(q), value[known_ones] + q)
            found |= {names[k]: column for k, column in zip(known_ones, drawn.T, strict=True)}
    if not found:
        raise AnalysisError(f"{path}: no parameter has a standard error")
    return found
