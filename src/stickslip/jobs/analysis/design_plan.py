"""The recordings that tell most of an actuator, as a design file asks for them."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from ...design import FreeDrives, Plan, plan_experiment
from ...quantities.arguments import arguments_of
from ...quantities.input_file import Part, RecordPart
from ...recording.chain import Chain
from ...recording.readers import read_recording
from ...report import Column, Number, Picture, Section, Table
from ...report.figures.plotting import plot
from ...report.figures.style import svg
from ...rig.experiment.cells import drive_of, limits_of
from ...rig.experiment.file import LimitsSpec, PartSpec
from .design_given import Given, Made, Quantity


class PlanSpec(arguments_of(plan_experiment, "recordings", "duration", "sample_rate", "over", "seed")):
    """As `plan_experiment`: `goal` is "all", a parameter, or a waveform whose step is to be predicted;
    `noise` a standard deviation, or a recording at rest; `channel` that of the position. With an
    `uncertainty` of the file the plan is the best one where it is worst among its draws."""

    free: list[str] = Field(min_length=1)
    goal: PartSpec | str = "all"
    noise: Quantity | None = None
    limits: LimitsSpec = Field(default_factory=LimitsSpec)
    channel: Annotated[Chain, RecordPart(without=("offset", "scale"))] = Field(default_factory=Chain)
    free_drives: Part[FreeDrives] | None = None
    like: str | None = None

    def made(self, given: Given) -> Made:
        """Plan, and write what to record; raises QuantityError."""
        goal: Any = drive_of([self.goal], {}, given.folder) if isinstance(self.goal, PartSpec) else self.goal
        plan = plan_experiment(
            given.model,
            self.free_drives,
            free=self.free,
            goal=goal,
            noise=self._noise(given.folder),
            limits=limits_of(self.limits, given.model),
            chain=self.channel,
            draws=given.uncertainty,
            progress=given.progress,
            **self.arguments,
        )
        files = self._files(plan, given.folder)
        section = Section(
            "Planned recordings",
            paragraphs=["experiment.yaml beside this report is the plan: stickslip record runs it."],
            tables=(_recordings_table(plan), _parameters_table(plan)),
            figures=(
                Picture(
                    "plan",
                    "Left, how many times smaller the error of the goal is by each candidate than by the "
                    "default in equal time; right, expected 95 % intervals.",
                    svg(plot(plan)[0].figure),
                    "Gain of each candidate over frequency, and half-widths of the intervals",
                ),
            ),
        )
        said = " ".join(line for line in plan.report().split("\n\n")[0].splitlines() if line)
        return Made(section, said, _plan_numbers(plan), files=files)

    def _noise(self, folder: Path) -> Any:
        if isinstance(self.noise, str) and (folder / self.noise).is_file():
            return read_recording(folder / self.noise)
        return self.noise

    def _files(self, plan: Plan, folder: Path) -> dict[str, str]:
        """The experiment file, and the parameter set beside it, where it needs one."""
        with tempfile.TemporaryDirectory() as made:
            plan.save(Path(made) / "experiment.yaml", like=None if self.like is None else folder / self.like)
            return {one.name: one.read_text(encoding="utf-8") for one in sorted(Path(made).iterdir())}


def _recordings_table(plan: Plan) -> Table:
    rows = [(name, walk.duration, walk.sample_rate, walk.repeats) for name, walk in plan.recordings.items()]
    columns = (Column("recording"), Column("length", "s"), Column("sample rate", "Hz"), Column("times", ""))
    return Table("What to record.", columns, rows)


def _parameters_table(plan: Plan) -> Table:
    of, rows = plan.dataset, []
    for name in of["parameter"].values.tolist():
        row = of.sel(parameter=name)
        shares = [float(row[n]) for n in ("half_width", "worst_half_width", "default_half_width")]
        cells = [Number(x, "", note="" if np.isfinite(x) else "not told") for x in shares]
        rows.append((name, Number(float(row["value"]), str(row["unit"].values)), *cells))
    columns = ("parameter", "value", "planned", "in the worst draw", "default in equal time")
    return Table(
        "Expected half-widths of 95 % intervals, as shares of the value.",
        tuple(Column(one) for one in columns),
        rows,
        notes="Linearised; the model and the noise are taken to be as told.",
    )


def _plan_numbers(plan: Plan) -> dict[str, Any]:
    of = plan.dataset
    shares = ("half_width", "worst_half_width", "default_half_width")
    found: dict[str, Any] = {
        "parameters": {
            name: {
                "value": float(of["value"].sel(parameter=name)),
                "unit": str(of["unit"].sel(parameter=name).values),
                **{n: float(of[n].sel(parameter=name)) for n in shares},
            }
            for name in of["parameter"].values.tolist()
        },
        "recordings": {
            name: {"duration": Number(walk.duration, "s"), "repeats": Number(walk.repeats, "")}
            for name, walk in plan.recordings.items()
        },
        "undetermined": list(plan.undetermined),
        "goal": plan.goal,
        "duration": Number(plan.duration, "s"),
    }
    return found
