"""Fields that the parts of a design file have in common: goals, limits, generator, conditions, draws."""

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
# Number of random draws of the parameters from the values, standard errors and correlations in a
# results.json. A part of a design uses all, draws some of them at random (with repetition), or takes evenly
# spaced ones.
DRAWS = 1000


class Given(NamedTuple):
    """Inputs of each part of a design file.

    `model` is the actuator. `uncertainty` has draws of its parameters in SI, arrays [draws] by name (None
    without uncertainty). `folder` is the folder of the relative paths in the file. `progress` is called with
    the activity and the finished fraction of the part, from 0 to 1.
    """

    model: Actuator
    uncertainty: dict[str, Array] | None
    folder: Path
    progress: Progress


class GoalSpec(Strict):
    """A goal of a search that needs a value; exactly one of these fields.

    `speed` is the direction in which the speed is maximised (1 or -1). `step` is the required step per period
    [m, or rad]. With `current`, the capacitance of the piezo [F], its peak current is minimised; with `heat`,
    the piezo stack, its mean loss.
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
        """Return the goal as a record of `design`, such as `Speed`; raise QuantityError for a wrong value."""
        if self.heat is not None:
            return Heat(self.heat)
        ((name, value),) = self.model_dump(exclude_unset=True).items()
        kinds: dict[str, Any] = {"speed": Speed, "step": StepSize, "current": Current}
        return kinds[name](value)


Goal = GoalSpec | str


def goal_of(given: Goal | None, model: Actuator) -> Any:
    """Return a goal in the form that the searches of `design` take.

    Args:
        given: a name such as "speed", a goal with a value, or None. Names other than "tip_load" and "noise",
            and None, are returned unchanged.
        model: the actuator, whose stage the goals "tip_load" and "noise" concern.

    Raises:
        QuantityError: the value of the goal is wrong.
    """
    if isinstance(given, GoalSpec):
        return given.goal()
    if given in ("tip_load", "noise"):
        return (TipLoad if given == "tip_load" else Noise).of_stage(model)
    return given


class OutputLimitsSpec(fields_of(OutputStage, "slew_rate", "current", "capacitance")):
    """Limits of an output stage: `slew_rate` [V/s] and `current` [A] with `capacitance` [F], or a `bench`.

    Slew rate or current may be left out; with both, the lower slope limits. A `bench` excludes them: its
    limits are those of its amplifier with its piezo as load.
    """

    bench: str | None = None

    def output(self, folder: Path) -> OutputStage:
        """Return an output stage with these limits.

        `folder` is the folder of the design file, for a bench in a file. Raises QuantityError for a wrong
        value, or for limits beside a bench.
        """
        if self.bench is None:
            return OutputStage(**self.given)
        if self.given:
            raise QuantityError(f"limits.{next(iter(self.given))} is that of limits.bench: give one of them")
        bench = load_bench(own_file(self.bench, folder, ".toml"))
        return OutputStage.of_amplifier(bench.amplifier, bench.piezo_capacitance)


class GeneratorSpec(fields_of(OutputStage, "update_rate", "points", "step", "interpolation")):
    """Waveform generator (digital-to-analogue converter) of an output stage.

    The generator has an `update_rate` [Hz], a number of `points` per period, a voltage `step` [V] and an
    `interpolation`. Or it is the converter of a `bench`, with a number of `points`.
    """

    bench: str | None = None

    def onto(self, output: OutputStage, folder: Path) -> OutputStage:
        """Return the output stage with this converter added, either of its own or of the bench.

        `folder` is the folder of the design file. Raises QuantityError if a field is missing or wrong.
        """
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
    """Return the output stage with these limits and this generator; None leaves out either of them.

    Raises QuantityError for a wrong value.
    """
    output = OutputStage() if limits is None else limits.output(folder)
    return output if generator is None else generator.onto(output, folder)


class ScenarioSpec(Strict):
    """A condition for which a drive must also work, such as a load.

    `change` has new values of fields of the actuator or its friction law by name, in SI or with units;
    `factors` has factors by which their values are multiplied. `name` is for the report.
    """

    name: str = ""
    change: dict[str, Quantity] = Field(default_factory=dict)
    factors: dict[str, Quantity] = Field(default_factory=dict)

    def scenario(self) -> Scenario:
        """Return the condition as a `Scenario`; raise QuantityError for a wrong value."""
        factors = {name: to_si(one, "", f"factors.{name}") for name, one in self.factors.items()}
        return Scenario(self.name, factors=factors, **self.change)


class SearchSpec(arguments_of(optimise_waveform, "max_voltage", "min_voltage", "frequency", "seed")):
    """Arguments that all searches for a drive, a front or an actuator have in common.

    They are those of `optimise_waveform`, with the `limits` of the amplifier, and `scenarios`, further
    conditions for which the drive must work.
    """

    limits: OutputLimitsSpec | None = None
    scenarios: list[ScenarioSpec] = Field(default_factory=list)

    def common(self, given: Given) -> dict[str, Any]:
        """Return the keyword arguments that all searches have in common.

        They are the fields of the file, output (the amplifier's limits), scenarios and progress. Raises
        QuantityError for wrong values.
        """
        return {
            **self.arguments,
            "output": output_stage(self.limits, None, given.folder),
            "scenarios": [one.scenario() for one in self.scenarios],
            "progress": given.progress,
        }


def draws_of_file(path: Path) -> dict[str, Array]:
    """Return draws of an actuator's parameters from a file, arrays [draws] in SI by name of the parameter.

    They are the samples of a posterior (NetCDF), or `DRAWS` random draws from the estimates of an
    identification or a campaign (results.json) with their standard errors and correlations. Positive
    parameters are log-normal, others normal; parameters without a standard error are left out.

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
