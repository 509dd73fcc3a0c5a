"""Analysis of a design file: step map, best drive, Pareto front, actuator search, experiment plan.

An example of a design file::

    kind: design
    title: What the stage can do
    model: kang2007                     # or fit: results.json of an identification
    uncertainty: posterior.nc           # or results.json; or fit: the uncertainty of the fit
    map:
      drive: {shape: Sawtooth, fields: {amplitude: 65 V, frequency: 5 Hz, rise_fraction: 0.95}}
      voltage: {start: 10 V, stop: 150 V, points: 40}
      frequency: {start: 5 Hz, stop: 1 kHz, points: 40, spacing: log}
      load: [0 N, -50 mN]
    optimise: {goal: speed, max_voltage: 100 V, scenarios: [{change: {external_force: -0.1 N}}]}
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError, model_validator

from ...identify.results import model_numbers
from ...quantities.input_file import explain, load_yaml
from ...quantities.progress import Progress, within
from ...quantities.units import QuantityError
from ...report import Document, Section
from ...report.document import joined
from ...report.origin import origin_of
from .design_drives import ActuatorSearchSpec, FrontSpec, OptimiseSpec
from .design_given import Array, Given, draws_of_file
from .design_map import MapSpec
from .design_plan import PlanSpec
from .file import Analysis, AnalysisError
from .model import ModelOrFit

PARTS = ("map", "optimise", "front", "actuator", "plan")
OF_FIT = "fit"


class DesignAnalysis(Analysis, ModelOrFit):
    """Content of a design file: its parts map, optimise, front, actuator and plan, at least one of them.

    `uncertainty` is the path of a file with draws or standard errors of the parameters, or "fit" for the
    uncertainty of the model's fit. Without it the parameters are exact.
    """

    kind: Literal["design"] = "design"
    uncertainty: str | None = None
    map: MapSpec | None = None
    optimise: OptimiseSpec | None = None
    front: FrontSpec | None = None
    actuator: ActuatorSearchSpec | None = None
    plan: PlanSpec | None = None

    @model_validator(mode="after")
    def _asks(self) -> DesignAnalysis:
        if not any(getattr(self, part) for part in PARTS):
            raise ValueError(f"a design asks for at least one of {', '.join(PARTS)}")
        return self

    def run(self, folder: Path, progress: Progress) -> Document:
        """Run all parts in turn and return the report.

        After a part that failed, the next parts are still run; after one that was stopped by Ctrl-C they are
        not. The report names both. If no earlier part has a result, however, the error or KeyboardInterrupt
        is raised at once.

        Raises:
            QuantityError, AnalysisError, ParameterSetError: a field is wrong, or a part failed.
        """
        model = self.load_model(folder)
        draws, origin = self._draws(folder), origin_of(model, [])
        parts = {name: getattr(self, name) for name in PARTS if getattr(self, name) is not None}
        made: dict[str, Document] = {}
        failures: list[str] = []
        stopped = ""
        for i, (name, spec) in enumerate(parts.items()):
            told = partial(within, progress, i / len(parts), 1.0 / len(parts))
            try:
                made[name] = spec.made(Given(model, draws, folder, told))
            except (QuantityError, AnalysisError) as error:
                said = str(error) if name == "map" else f"{name}: {error}"
                if not made:
                    raise QuantityError(said) from error
                failures.append(said)
                continue
            except KeyboardInterrupt:
                if not made:
                    raise
                stopped = f"{name}: stopped before anything was found"
            else:
                stopped = "; ".join(f"{name}: {one}" for one in made[name].failures)
            if stopped:
                left = [f"not begun: {', '.join(list(parts)[i + 1 :])}"] if i + 1 < len(parts) else []
                failures += [stopped, *left]
                break
        notes = (Section("Notes", paragraphs=(self.notes,)),) if self.notes else ()
        whole = joined(*made.values())
        return replace(
            whole,
            title=self.title,
            sections=(*notes, *whole.sections),
            numbers={**{name: one.numbers for name, one in made.items()}, "model": model_numbers(model)},
            assumptions=origin.assumptions,
            citations=origin.citations,
            failures=failures,
            interrupted=bool(stopped),
        )

    def _draws(self, folder: Path) -> dict[str, Array] | None:
        if self.uncertainty is None:
            return None
        if self.uncertainty == OF_FIT and self.fit is None:
            raise AnalysisError("uncertainty: fit: there is no fit, the model is a parameter set")
        return draws_of_file(folder / str(self.fit if self.uncertainty == OF_FIT else self.uncertainty))


def design_analysis(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> tuple[DesignAnalysis, Path]:
    """Return the content of a design file, and the folder of the relative paths in it.

    Args:
        path: path of the file.
        changes: changes to its content, as for `load_yaml`.

    Raises:
        AnalysisError: the file is invalid; the message names the file and the field.
    """
    content = load_yaml(path, changes)
    if "kind" in content and content["kind"] != "design":
        raise AnalysisError(f"{path}: kind: a design file has the kind 'design', not {content['kind']!r}")
    try:
        return DesignAnalysis.model_validate(content), Path(path).parent
    except ValidationError as error:
        raise explain(path, error, content=content) from error


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of design files, for editors."""
    return DesignAnalysis.model_json_schema()
