"""Part of a design file that plans an experiment: the most informative recordings."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from ...design import FreeDrives, Plan, plan_experiment
from ...quantities.arguments import arguments_of
from ...quantities.input_file import Part, RecordPart
from ...recording.chain import Chain
from ...recording.readers import read_recording
from ...report.document import Document, begun_by
from ...report.viewing import view
from ...rig.experiment.cells import drive_of, limits_of
from ...rig.experiment.file import LimitsSpec, PartSpec
from .design_given import Given, Quantity


class PlanSpec(arguments_of(plan_experiment, "recordings", "duration", "sample_rate", "over", "seed")):
    """Arguments of `plan_experiment`.

    `free` names the parameters that the recordings shall identify. `goal` is what they shall determine best:
    "all" parameters, one parameter, or the step of a waveform. `noise` is the standard deviation of the
    position [m, or rad], or the name of a file with a recording at rest. `channel` describes the position
    channel. `like` is the name of an experiment file whose rig, channels and actuator the plan takes over.
    With an `uncertainty` in the design file the plan is the best one for the worst of its draws, or on
    average (`over: mean`).
    """

    free: list[str] = Field(min_length=1)
    goal: PartSpec | str = "all"
    noise: Quantity | None = None
    limits: LimitsSpec = Field(default_factory=LimitsSpec)
    channel: Annotated[Chain, RecordPart(without=("offset", "scale"))] = Field(default_factory=Chain)
    free_drives: Part[FreeDrives] | None = None
    like: str | None = None

    def made(self, given: Given) -> Document:
        """Plan the recordings; return a report with experiment.yaml, an experiment file that makes them.

        Raises QuantityError for wrong values, RecordingError if the file `noise` cannot be read, and
        InputFileError if `like` cannot be read or is no experiment file.
        """
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
        said = "experiment.yaml beside this report is the plan: stickslip record runs it."
        return replace(begun_by(view(plan), said), files=self._files(plan, given.folder))

    def _noise(self, folder: Path) -> Any:
        if isinstance(self.noise, str) and (folder / self.noise).is_file():
            return read_recording(folder / self.noise)
        return self.noise

    def _files(self, plan: Plan, folder: Path) -> dict[str, str]:
        """Return the texts of the experiment file of the plan and of the files that it needs, by file name.

        `folder` is the folder of the design file, to which the path `like` is relative.
        """
        with tempfile.TemporaryDirectory() as made:
            plan.save(Path(made) / "experiment.yaml", like=None if self.like is None else folder / self.like)
            return {one.name: one.read_text(encoding="utf-8") for one in sorted(Path(made).iterdir())}
