"""Analysis of a slider that is pulled through a spring at a constant speed.

Friction is identified from one recording; the stick-slip motion in the other recordings is predicted.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np

from ...estimate.result import Fit
from ...identify.events.pulled import (
    Events,
    PulledRig,
    identify_pulled_slider,
    simulated_force,
    slider,
    slip_events,
)
from ...parameters import cite
from ...quantities.arguments import arguments_of
from ...quantities.input_file import fields_of, quantity
from ...quantities.progress import Progress
from ...report import Column, Document, Number, Picture, Section, Table
from ...report.figures.events import event_prediction
from ...report.figures.style import svg
from ...report.fits import estimates, parameter_table
from .file import Analysis, AnalysisError, RecordingFile, read_parts

if TYPE_CHECKING:
    import xarray as xr


class PulledRecording(RecordingFile, fields_of(PulledRig, "stiffness", "speed")):
    """A recording of the spring force over the slider's weight, channel `force_ratio` (no unit).

    `stiffness` is that of the spring [N/m], and `speed` the speed at which its far end is pulled [m/s].
    """


class PulledAnalysis(Analysis, arguments_of(identify_pulled_slider, "tied")):
    """Request to fit the friction of a pulled slider.

    Exactly one recording has `use: fit`; the others are predicted. `mass` is that of the slider [kg], and
    `tied` is as for `identify_pulled_slider`.
    """

    kind: Literal["pulled_slider"]
    mass: Annotated[float, quantity("kg")]
    recordings: list[PulledRecording]

    def run(self, folder: Path, progress: Progress) -> Document:
        """Fit the friction to one recording and predict the others; return the report.

        Raises AnalysisError unless exactly one recording has 'use: fit', the errors of `read_parts`, and
        FitError.
        """
        fitted = [r for r in self.recordings if r.use == "fit"]
        if len(fitted) != 1:
            raise AnalysisError(
                f"a pulled_slider analysis fits one recording and predicts the others, not {len(fitted)}"
            )
        progress(f"fitting {fitted[0].label}", 0.0)
        parts = read_parts(self.recordings, folder)
        data = {r.label: (parts[r.label], PulledRig(self.mass, **r.given)) for r in self.recordings}
        fit = identify_pulled_slider(*data[fitted[0].label], **self.arguments)
        predicted = []
        for i, (label, (recording, rig)) in enumerate(data.items()):
            progress(f"predicting {label}", 0.3 + 0.7 * i / len(data))
            predicted.append(_predicted(label, recording, rig, fit, fitted[0].label))
        return self._document(fit, predicted)

    def _document(self, fit: Fit, predicted: list[_Predicted]) -> Document:
        static, dynamic = _coefficients(fit)
        unseen = [one for one in predicted if one.role == "predicted"]
        right = sum(one.measured.regime == one.model.regime for one in unseen)
        impossible = [
            f"{one.label}: {one.measured.impossible}." for one in predicted if one.measured.impossible
        ]
        return Document(
            title=self.title,
            summary=(
                f"Friction coefficients from one speed: static {static:.3f}, dynamic {dynamic:.3f}."
                + _verified(unseen, right)
                + "".join(f" {said}" for said in impossible)
            ),
            sections=(
                Section(
                    "Friction coefficients from one recording",
                    paragraphs=(
                        "Least squares on the mean highest and lowest spring force and the mean period of "
                        "the events, weighted by their covariance, against the simulated slider "
                        "(stiction and Coulomb friction, true rest).",
                    ),
                    tables=(parameter_table("Identified parameters.", fit),),
                ),
                Section(
                    "Other springs and speeds, predicted",
                    paragraphs=(self.notes,) if self.notes else (),
                    points=impossible,
                    tables=(_events_table(predicted),),
                    figures=(
                        Picture(
                            "pulled_slider_events",
                            "Spring force over the weight, measured and simulated, over a few events of each "
                            "condition. Only the first was fitted.",
                            svg(event_prediction({one.label: one.traces for one in predicted})),
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
                "predictions": {one.label.replace(".", "_"): _numbers(one) for one in predicted},
            },
            assumptions=(
                "Friction coefficients do not depend on the time at rest or on the speed; paper is "
                "known to age, so slow pulling is predicted worst.",
            ),
            citations=cite(*self.citation) if self.citation else "",
        )


class _Predicted(NamedTuple):
    """A recording and its simulation.

    `role` is "fitted" or "predicted". `measured` and `model` are the stick-slip events in both, and `traces`
    the recorded and the simulated spring force over the slider's weight.
    """

    label: str
    role: str
    measured: Events
    model: Events
    traces: tuple[xr.Dataset, xr.Dataset]

    @property
    def periods(self) -> tuple[float, float]:
        """Return the mean period of the stick-slip events, measured and simulated, s; NaN without events."""
        return _mean(self.measured.period), _mean(self.model.period)

    @property
    def period_error(self) -> float:
        """Return the deviation of the simulated from the measured mean period, % of the latter; NaN without
        events."""
        measured, model = self.periods
        return 100.0 * (model / measured - 1.0)


def _coefficients(fit: Fit) -> tuple[float, float]:
    """Return the static and the dynamic friction coefficient of a fit, in this order."""
    dynamic = fit.values["dynamic_coefficient"]
    return dynamic + fit.values["stiction_excess"], dynamic


def _predicted(label: str, recording: xr.Dataset, rig: PulledRig, fit: Fit, fitted: str) -> _Predicted:
    measured = slip_events(recording, rig)
    simulated = simulated_force(slider(rig, *_coefficients(fit)), rig)
    role = "fitted" if label == fitted else "predicted"
    return _Predicted(label, role, measured, slip_events(simulated, rig), (recording, simulated))


def _verified(unseen: list[_Predicted], right: int) -> str:
    """Return a sentence on the predictions of recordings that were not fitted; "" without such recordings.

    `right` is the number of them whose regime (such as stick-slip) was predicted rightly.
    """
    errors = [abs(one.period_error) for one in unseen if np.isfinite(one.period_error)]
    said = f" The regime is predicted rightly for {right} of {len(unseen)} other conditions"
    if errors:
        said += f", the event period within {min(errors):.0f} to {max(errors):.0f} %"
    return f"{said}." if unseen else ""


def _events_table(predicted: list[_Predicted]) -> Table:
    return Table(
        "Stick-slip events, measured and from the model.",
        (
            Column("recording"), Column("role"), Column("regime, measured / model"),
            Column("sticking, measured", "", 2), Column("sticking, model", "", 2), Column("events", ""),
            Column("period, measured", "s", 3), Column("period, model", "s", 3),
            Column("error of the period", "%", 2),
        ),
        [
            (
                one.label, one.role, f"{one.measured.regime} / {one.model.regime}", one.measured.sticking,
                one.model.sticking, one.measured.period.size, *one.periods, one.period_error,
            )
            for one in predicted
        ],
        notes="Sticking is the part of the time at rest. Where events come within two free periods of "
        "the slider on its spring, the regime is called inertial.",
    )  # fmt: skip


def _numbers(one: _Predicted) -> dict[str, Number]:
    measured, model = one.periods
    return {
        "measured_period": Number(measured, "s"),
        "predicted_period": Number(model, "s"),
        "measured_sticking": Number(one.measured.sticking, ""),
        "predicted_sticking": Number(one.model.sticking, ""),
    }


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if values.size else float("nan")
