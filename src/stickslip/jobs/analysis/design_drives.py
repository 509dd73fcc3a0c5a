"""Parts of a design file that search: for the best drive, a Pareto front of two goals, a better actuator."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np

from ...design import (
    optimise_actuator,
    optimise_waveform,
    waveform_front,
)
from ...quantities.arguments import arguments_of
from ...quantities.input_file import yaml_text
from ...report import Document
from ...report.viewing import view
from ...waveform.knots import PeriodicKnots
from .design_given import (
    GeneratorSpec,
    Given,
    Goal,
    Quantity,
    SearchSpec,
    goal_of,
    output_stage,
)
from .model import named_model


class OptimiseSpec(
    SearchSpec, arguments_of(optimise_waveform, "knots", "draws", "quantile", "minimum_speed", "budget")
):
    """Arguments of `optimise_waveform`, which searches for the best drive.

    `goal` is "speed", which is maximised; "ripple", "backward_rate", "tip_load" (tension of the piezo) or
    "noise" (acceleration of the stage), which are minimised; or a goal with a value such as {step: 2 um}, see
    `GoalSpec`. `draws` is the number of draws from the file's `uncertainty`, if it has one. `limits` describe
    the amplifier, and `generator` the converter.
    """

    goal: Goal | None = None
    generator: GeneratorSpec | None = None

    def made(self, given: Given) -> Document:
        """Search for the best drive; return a report, and files with the drive.

        The files are drive.yaml, for a run of an experiment file, and with a converter drive.csv, its output
        over a period. Raises QuantityError for wrong values.
        """
        common = self.common(given)
        common["output"] = output_stage(self.limits, self.generator, given.folder)
        found = optimise_waveform(
            given.model,
            goal=goal_of(self.goal, given.model),
            uncertainty=given.uncertainty,
            **common,
        )
        files = {"drive.yaml": _run_of(found.waveform)}
        if found.played is not None:
            files["drive.csv"] = _csv(found.played)
        return replace(view(found), files=files)


class FrontSpec(SearchSpec, arguments_of(waveform_front, "knots", "points", "generations")):
    """Arguments of `design.waveform_front`, which searches the Pareto-optimal drives for two goals.

    `goals` are the two goals, each as in `OptimiseSpec`. The first must require motion, such as "speed".
    """

    goals: list[Goal] = ["speed"]  # noqa: RUF012  # pydantic copies the default

    def made(self, given: Given) -> Document:
        """Search for the Pareto front; return a report. Raises QuantityError for wrong values."""
        found = waveform_front(
            given.model,
            goals=tuple(goal_of(one, given.model) for one in self.goals),  # type: ignore[arg-type]
            **self.common(given),
        )
        return view(found)


class ActuatorSearchSpec(
    SearchSpec, arguments_of(optimise_actuator, "draws", "minimum_speed", "holding_force", "budget")
):
    """Arguments of `design.optimise_actuator`, which searches for the actuator that reaches a goal best.

    `free` has the ranges of the fields that are varied, by name: [lowest, highest], in SI or with units.
    `models` has names of parameter sets, each under a label for the report; the search then starts from each
    of them instead of the file's model.
    """

    goal: Goal | None = None
    free: dict[str, list[Quantity]]
    models: dict[str, str] | None = None

    def made(self, given: Given) -> Document:
        """Search for the best actuator; return a report.

        Raises QuantityError for wrong values, and ParameterSetError for an unknown parameter set.
        """
        models = {name: named_model(given.folder, one) for name, one in (self.models or {}).items()}
        found = optimise_actuator(
            models or given.model,
            goal=goal_of(self.goal, given.model),
            free=self.free,
            uncertainty=given.uncertainty,
            **self.common(given),
        )
        return view(found)


def _run_of(waveform: PeriodicKnots) -> str:
    """Return YAML text with the entry ``waveform:`` of a run in an experiment file; times in s, voltages in
    V."""
    fields = {"times": [*waveform.times], "values": [*waveform.values], "period": waveform.period}
    made = {"waveform": [{"shape": "PeriodicKnots", "fields": fields}]}
    return "# For a run of an experiment file; s, V.\n" + yaml_text(made)


def _csv(played: Any) -> str:
    """Return one period of the generator's output as CSV text, with the header "time [s],voltage [V]".

    `played` is the sampled waveform, with `times` and `values`.
    """
    text = io.StringIO()
    np.savetxt(
        text,
        np.column_stack([played.times, played.values]),
        "%.9g",
        ",",
        header="time [s],voltage [V]",
        comments="",
    )
    return text.getvalue()
