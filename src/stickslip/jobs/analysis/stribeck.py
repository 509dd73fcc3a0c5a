"""Analysis of steady friction: a Stribeck curve fitted to points of velocity and friction force."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ...estimate.result import Fit
from ...identify.stribeck import identify_stribeck
from ...parameters import cite
from ...quantities.input_file import quantity
from ...quantities.progress import Progress
from ...recording.readers.points import read_points
from ...report import Document, Number, Picture, Section
from ...report.figures.steady_friction import steady_friction
from ...report.figures.style import svg
from ...report.fits import estimates, parameter_table
from .file import Analysis, SourceFile


class PointsFile(SourceFile):
    """A file with a table of points; `columns` and `units` of velocity and force are as for `read_points`."""

    columns: dict[str, str | int] = Field(default_factory=dict)
    units: dict[str, str] = Field(default_factory=dict)


class StribeckAnalysis(Analysis):
    """Request to fit a Stribeck curve to points of velocity and force.

    `deviation` is the standard deviation of each force [N], None if unknown. `exponent` is the exponent of
    the Stribeck curve; null means that it is fitted. `offset: true` also fits an offset of the force sensor.
    `tied` is as for `identify_stribeck`.
    """

    kind: Literal["stribeck"]
    points: PointsFile
    deviation: Annotated[float, quantity("N")] | None = None
    exponent: Annotated[float, Field(gt=0, le=10)] | None = 2.0
    offset: bool = False
    tied: dict[str, str] = Field(default_factory=dict)

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit the curve to the points; return the report.

        Raises RecordingError if the points cannot be read, and FitError or QuantityError from
        `identify_stribeck`.
        """
        progress("fitting the points", 0.0)
        points = read_points(self.points.path(folder), self.points.columns, self.points.units)
        fit = identify_stribeck(
            points["velocity"],
            points["force"],
            deviation=self.deviation,
            exponent=self.exponent,
            offset=self.offset,
            tied=self.tied,
        )
        return self._document(fit, points)

    def _document(self, fit: Fit, points: dict[str, np.ndarray]) -> Document:
        law = fit.model
        without_offset = points["force"] - fit.values.get("offset", 0.0)
        return Document(
            title=self.title,
            summary=(
                f"Coulomb friction {law.coulomb_force:.4g} N, stiction {law.stiction_force:.4g} N, Stribeck "
                f"velocity {law.stribeck_velocity:.3g} m/s, from {points['velocity'].size} points."
            ),
            sections=(
                Section(
                    "Steady friction over velocity",
                    paragraphs=(self.notes,) if self.notes else (),
                    tables=(parameter_table("Identified parameters.", fit),),
                    figures=(
                        Picture(
                            "steady_friction",
                            "Friction force over velocity, the points and the fitted Stribeck curve.",
                            svg(steady_friction(points["velocity"], without_offset, law)),
                            "Points of friction force over velocity, with a curve through them",
                        ),
                    ),
                ),
            ),
            highlights=(
                ("Coulomb friction", estimates(fit)["coulomb_force"]),
                ("stiction", Number(law.stiction_force, "N")),
            ),
            numbers={
                "parameters": estimates(fit),
                "stiction_force": Number(law.stiction_force, "N"),
                "r_squared": Number(fit.r_squared, ""),
            },
            citations=cite(*self.citation) if self.citation else "",
        )
