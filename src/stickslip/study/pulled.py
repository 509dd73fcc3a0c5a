"""Study: a slider pulled through a spring, its friction from one recording, its stick-slip predicted for
others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from ..figures.events import event_prediction
from ..figures.style import svg
from ..identify.events.pulled import PulledRig, identify_pulled_slider, simulated_force, slider, slip_events
from ..input_file import quantity
from ..parameters import cite
from ..progress import Progress
from ..report import Column, Document, Number, Picture, Section, Table
from ..report.fits import estimates, parameter_table
from .file import RecordingFile, Study, StudyError, read_parts


class PulledRecording(RecordingFile):
    """A recording of the spring force over the weight (`force_ratio`), and how the slider was pulled."""

    stiffness: Annotated[float, quantity("N/m")]
    speed: Annotated[float, quantity("m/s")]


class PulledStudy(Study):
    """See the module. Exactly one recording is for the fit; `tied` as for `identify_pulled_slider`."""

    kind: Literal["pulled_slider"]
    mass: Annotated[float, quantity("kg")]
    tied: dict[str, str] = {}  # noqa: RUF012  # pydantic copies it
    recordings: list[PulledRecording]

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit and predict."""
        fitted = [r for r in self.recordings if r.use == "fit"]
        if len(fitted) != 1:
            raise StudyError(
                f"a pulled_slider study fits one recording and predicts the others, not {len(fitted)}"
            )
        progress(f"fitting {fitted[0].label}", 0.0)
        parts = read_parts(self.recordings, folder)
        data = {
            r.label: (parts[r.label], PulledRig(self.mass, r.stiffness, r.speed)) for r in self.recordings
        }
        fit = identify_pulled_slider(*data[fitted[0].label], tied=self.tied)
        dynamic = fit.values["dynamic_coefficient"]
        static = dynamic + fit.values["stiction_excess"]
        rows, traces, right, impossible = [], {}, 0, []
        for i, (label, (recording, rig)) in enumerate(data.items()):
            progress(f"predicting {label}", 0.3 + 0.7 * i / len(data))
            found = slip_events(recording, rig)
            simulated = simulated_force(slider(rig, static, dynamic), rig)
            model = slip_events(simulated, rig)
            traces[label] = (recording, simulated)
            if found.impossible:
                impossible.append(f"{label}: {found.impossible}.")
            period = _mean(found.period), _mean(model.period)
            role = "fitted" if label == fitted[0].label else "predicted"
            rows.append(
                (
                    label, role, f"{found.regime} / {model.regime}", found.sticking, model.sticking,
                    found.period.size, *period, 100.0 * (period[1] / period[0] - 1.0),
                )
            )  # fmt: skip
            right += role == "predicted" and found.regime == model.regime
        unseen = [r for r in rows if r[1] == "predicted"]
        table = Table(
            "Stick-slip events, measured and from the model.",
            (
                Column("recording"), Column("role"), Column("regime, measured / model"),
                Column("sticking, measured", "", 2), Column("sticking, model", "", 2), Column("events", ""),
                Column("period, measured", "s", 3), Column("period, model", "s", 3),
                Column("error of the period", "%", 2),
            ),
            rows,
            notes="Sticking is the part of the time at rest. Where events come within two free periods of "
            "the slider on its spring, the regime is called inertial.",
        )  # fmt: skip
        errors = [abs(r[-1]) for r in unseen if np.isfinite(r[-1])]
        verified = ""
        if unseen:
            verified = f" The regime is predicted rightly for {right} of {len(unseen)} other conditions"
            if errors:
                verified += f", the event period within {min(errors):.0f} to {max(errors):.0f} %"
            verified += "."
        return Document(
            title=self.title,
            summary=(
                f"Friction coefficients from one speed: static {static:.3f}, dynamic {dynamic:.3f}.{verified}"
                + "".join(f" {said}" for said in impossible)
            ),
            sections=(
                Section(
                    "Friction coefficients from one recording",
                    paragraphs=(
                        "Least squares on the mean highest and lowest spring force and the mean period of "
                        "the events, each weighted by its standard error, against the simulated slider "
                        "(stiction and Coulomb friction, true rest).",
                    ),
                    tables=(parameter_table("Identified parameters.", fit),),
                ),
                Section(
                    "Other springs and speeds, predicted",
                    paragraphs=(self.notes,) if self.notes else (),
                    points=impossible,
                    tables=(table,),
                    figures=(
                        Picture(
                            "pulled_slider_events",
                            "Spring force over the weight, measured and simulated, over a few events of each "
                            "condition. Only the first was fitted.",
                            svg(event_prediction(traces)),
                            "Saw-tooth like force traces, measured and simulated, for each spring and speed",
                        ),
                    ),
                ),
            ),
            highlights=(
                ("static friction coefficient", Number(static, "")),
                ("dynamic friction coefficient", Number(dynamic, "")),
                (f"regimes predicted rightly, of {len(unseen)}", Number(right, "")),
            ),
            numbers={
                "parameters": estimates(fit),
                "static_coefficient": Number(static, ""),
                "predictions": {
                    r[0].replace(".", "_"): {
                        "measured_period": Number(r[6], "s"),
                        "predicted_period": Number(r[7], "s"),
                        "measured_sticking": Number(r[3], ""),
                        "predicted_sticking": Number(r[4], ""),
                    }
                    for r in rows
                },
            },
            assumptions=(
                "Friction coefficients do not depend on the time at rest or on the speed; paper is "
                "known to age, so slow pulling is predicted worst.",
            ),
            citations=cite(*self.citation) if self.citation else "",
        )


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else float("nan")
