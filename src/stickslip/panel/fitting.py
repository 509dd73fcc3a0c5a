"""A fit for the Identify page: read recordings, fit, verify, write the report, and send messages meanwhile.

As in `stickslip campaign`, recordings with the end-effector clamped are fitted first: slow loops give
hysteresis and creep, steps give the vibration mode of the stage.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..estimate.result import Fit
from ..estimate.search import SearchState
from ..identify.results import chain_numbers
from ..identify.step.fit import STAGE_PARAMETERS, identify_step, step_level
from ..identify.step.recorded_step import step_tests
from ..identify.verification import verify
from ..identify.walk.displacement import Displacement, has_slopes
from ..identify.walk.friction import identify_friction
from ..identify.walk.joint import jointly
from ..identify.walk.position_channel import CHANNEL, OBSERVED
from ..identify.walk.walks import Varied, observed
from ..jobs.campaign.hysteresis import Hysteresis, hysteresis_in
from ..jobs.campaign.hysteresis_section import hysteresis_section
from ..physics.actuator import Actuator
from ..quantities.units import QuantityError, to_si
from ..recording import RecordingError
from ..recording.chain import Chain
from ..recording.readers import read_recording
from ..report import write_report
from ..report.walks import UsedWalk, walk_document
from .fit_request import FitRequest
from .folder import Folder
from .sets import Sets

if TYPE_CHECKING:
    import xarray as xr

PAUSE = 0.12  # shortest time between two messages "step" of a running fit, s
SHOWN = 2000  # largest number of samples of a curve that is sent, about
STEP_SHOWN = 0.02  # time after the voltage step for which a step response is drawn, s
_DRAFT = 1e-10  # tolerance of positions in simulations that are only drawn, m (or rad for rotary actuators)

Array = NDArray[np.float64]
# Type of the function that sends a message on the progress: kind, fields, and arrays to draw.
Say = Callable[[str, dict[str, Any], Sequence[Array]], None]


def fit_recordings(request: FitRequest, folder: Folder, out: str, say: Say) -> None:
    """Fit as requested, verify the fit, write its report, and send messages on the progress.

    Messages in order, each with its fields and curves: "hysteresis" (hysteresis, hysteresis_said); "stage"
    (stage, step_names; time, measured and modelled position of each step); "recordings" (names, unit; time
    and position of each walk); "step", often (values so far, rmse, evaluations; position of the model in each
    walk); "fitted" (fit, model, correlation, advised); "verified" (verification; time, measured and predicted
    position of each); "report" (report, notes). Messages on recordings that the request does not name are
    left out.

    Args:
        request: recordings, initial guess and free parameters.
        folder: the panel's folder, with the recordings.
        out: name of its subfolder for the report.
        say: called with kind, fields and curves of each message.

    Raises:
        RecordingError, QuantityError, FitError: a recording cannot be read, a value is wrong, a free
            parameter is given by the steps, or the fit failed; see `identify_friction`.
    """
    start = request.actuator(Sets(folder))
    rate = None if request.slew_rate is None else to_si(request.slew_rate, "V/s", "slew_rate")
    taken = sorted({*STAGE_PARAMETERS} & {*request.free}) if request.steps else []
    if taken:
        raise QuantityError(f"{', '.join(taken)}: given by the steps, and so not free in the walk")
    seen = [_read(folder, name, request) for name in request.recordings]
    unseen = [_read(folder, name, request) for name in request.others if name not in request.recordings]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        loops, steps = (_named(folder, names) for names in (request.loops, request.steps))
        bent = _bent(loops, start, say)
        begun = start if bent is None else bent.fit.model
        stage = _stage(steps, begun, rate, say)
        actuator = begun if stage is None else stage.model
        drafts = _Drafts(seen, request, say, rate)
        drafts.begin(actuator)
        fit = identify_friction(
            seen,
            actuator,
            request.free,
            slew_rate=rate,
            stage=stage if bent is None else None,
            initial=None if stage is None or bent is None else {"delay": stage.values["delay"]},
            bounds={name: (limits[0], limits[1]) for name, limits in request.bounds.items()},  # type: ignore[arg-type]
            starts=request.starts,
            hops=request.hops,
            each=drafts,
        )
        if bent is not None and stage is not None and has_slopes(fit.model):
            known = bent.refitted(lambda one: identify_step(steps, one, slew_rate=rate)).widened(stage)
            fit = jointly(fit, seen, [None] * len(seen), known, rate, actuator, request.hops)
        drafts.draw(fit.values)
        told = {
            "model": _told(fit, stage),
            "correlation": _correlation(fit),
            "advised": _advised(request, fit),
        }
        say("fitted", {"fit": fit.to_dict(), **told}, [])
        if unseen:
            found = verify(fit, unseen)
            traces = [p[k].values for p in found.predictions for k in ("time", "measured", "predicted")]
            say("verified", {"verification": found.to_dict()}, [_thin(one) for one in traces])
        walks = {str(r.title): UsedWalk("fit", r) for r in seen}
        walks |= {str(r.title): UsedWalk("verify", r) for r in unseen}
        notes = "" if stage is None else _said_of(stage, request.steps)
        document = walk_document("Identification", fit, actuator, walks, notes)
        # The results also get the amplifier's slew rate, which no fit contains, because `stickslip verify`
        # needs it.
        known = math.inf if rate is None else rate
        chain = Chain(fit.values.get("delay", 0.0), fit.values.get("offset", 0.0), slew_rate=known)
        numbers = {**document.numbers, "signal_chain": chain_numbers(chain)}
        document = replace(document, numbers=numbers)
        if bent is not None:
            first = hysteresis_section(bent, loops, figures=True)
            document = replace(document, sections=[first, *document.sections])
        write_report(document, folder.path(out), command="stickslip panel")
    said = dict.fromkeys((*numbers["drives"], *(" ".join(str(w.message).split()) for w in caught)))
    say("report", {"report": f"{out}/report.html", "notes": list(said)}, [])


def _named(folder: Folder, names: Sequence[str]) -> list[xr.Dataset]:
    """Return whole recordings of the folder by name, with their names as titles."""
    return [read_recording(folder.path(name)).assign_attrs(title=name) for name in names]


def _bent(loops: Sequence[xr.Dataset], start: Actuator, say: Say) -> Hysteresis | None:
    """Fit hysteresis and creep to the loops, and send the message "hysteresis"; None without loops.

    `start` is the actuator with initial values.
    """
    if not loops:
        return None
    found = hysteresis_in(loops, start, OBSERVED)
    say("hysteresis", {"hysteresis": found.fit.to_dict(), "hysteresis_said": found.sentence}, [])
    return found


def _stage(steps: Sequence[xr.Dataset], start: Actuator, rate: float | None, say: Say) -> Fit | None:
    """Fit the stage to the clamped steps, and send the message "stage" with its curves; None without steps.

    Args:
        steps: recordings of voltage steps.
        start: actuator with initial values.
        rate: slew rate of the amplifier, V/s; None if unknown.
        say: sends the message.
    """
    if not steps:
        return None
    fit = identify_step(steps, start, slew_rate=rate)
    assert fit.predict is not None
    curves = []
    for i, (one, test) in enumerate(zip(steps, step_tests(steps), strict=True), start=1):
        moved = test.position - step_level(fit.values, i, test.time)
        curves += [_thin(part) for part in _near(one, moved, fit.predict(one))]
    say("stage", {"stage": fit.to_dict(), "step_names": [str(one.title) for one in steps]}, curves)
    return fit


def _near(step: xr.Dataset, measured: Array, model: Array) -> tuple[Array, Array, Array]:
    """Return the part of a step response that is drawn: time [s], measured and modelled position [m, or rad].

    It extends from `STEP_SHOWN` / 4 before to `STEP_SHOWN` after the voltage step, the first sample at which
    the drive has changed by more than half its range.
    """
    time_, drive = step["time"].values, step["drive_voltage"].values
    at = time_[int(np.argmax(np.abs(drive - drive[0]) > 0.5 * np.ptp(drive)))]
    kept = (time_ > at - STEP_SHOWN / 4) & (time_ < at + STEP_SHOWN)
    return time_[kept], measured[kept], model[kept]


def _said_of(stage: Fit, names: Sequence[str]) -> str:
    found = [
        f"{p.name.replace('_', ' ')} {stage.values[p.name]:.4g} {p.unit}".strip() + f" ± {error:.2g}"
        for p in stage.parameters
        for error in [stage.standard_errors[p.name]]
        if p.name in STAGE_PARAMETERS
    ]
    return f"The stage is that of the clamped steps {', '.join(names)}: {'; '.join(found)} (standard errors)."


class _Drafts:
    """Sends the curves of the best model so far while a fit is running.

    `identify_friction` calls it after every evaluation of the model.
    """

    def __init__(
        self, recordings: Sequence[xr.Dataset], request: FitRequest, say: Say, slew_rate: float | None
    ) -> None:
        self._recordings, self._say, self._slew_rate = recordings, say, slew_rate
        self._channel = [name for name in request.free if name in CHANNEL]
        self._shown, self._next = math.inf, 0.0
        self._count = sum(r.sizes["time"] for r in recordings)

    def begin(self, actuator: Actuator) -> None:
        """Prepare the simulations of all recordings; send the recordings and the curves of the initial model.

        `actuator` has the initial values.
        """
        names = [str(r.title) for r in self._recordings]
        self._varied = Varied(actuator)
        self._motions = [
            Displacement(r, None, name, actuator, _DRAFT, self._slew_rate)
            for r, name in zip(self._recordings, names, strict=True)
        ]
        traces = [r[k].values for r in self._recordings for k in ("time", OBSERVED)]
        unit = str(self._recordings[0][OBSERVED].attrs["units"])
        self._say("recordings", {"names": names, "unit": unit}, [_thin(one) for one in traces])
        self.draw({})  # without values, the initial ones are used

    def __call__(self, state: SearchState) -> None:
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + PAUSE
        fields = {
            "evaluations": state.evaluations,
            "start": state.start,
            "starts": state.starts,
            "rmse": math.sqrt(state.sum_of_squares / self._count),
            "values": state.values,
        }
        if state.sum_of_squares == self._shown:
            self._say("step", fields, [])
        else:
            self._shown = state.sum_of_squares
            self.draw(state.values, fields)

    def draw(self, values: Mapping[str, float], fields: dict[str, Any] | None = None) -> None:
        """Send the message "step" with the model's curves for these values of the parameters.

        `values` are in SI, by name of a parameter. `fields` are the fields of the message; by default only
        the values. Without curves if a simulation with these values fails.
        """
        try:
            curves = [observed(motion, self._varied, dict(values)) for motion in self._motions]
        except ArithmeticError:  # some trial values cannot be simulated; no curves are sent
            curves = []
        self._say("step", fields or {"values": dict(values)}, [_thin(curve) for curve in curves])


def _read(folder: Folder, name: str, request: FitRequest) -> xr.Dataset:
    recording = read_recording(folder.path(name))
    limits = [
        None if t is None else to_si(t, "s", f) for t, f in ((request.begin, "begin"), (request.end, "end"))
    ]
    part = recording.sel(time=slice(*limits))
    if part.sizes["time"] < 2:
        raise QuantityError(f"begin = {request.begin} s and end = {request.end} s leave nothing of {name}")
    if OBSERVED not in part:
        raise RecordingError(f"{name} has no channel {OBSERVED}, which is what is fitted")
    return part.assign_attrs(title=name)


def _thin(values: Array) -> Array:
    """Return every n-th sample of a curve, with its first and last sample; n is chosen for about `SHOWN`
    samples."""
    if not values.size:
        return values
    end = values.size - 1
    return values[np.append(np.arange(0, end, math.ceil(values.size / SHOWN)), end)]


def _told(fit: Fit, stage: Fit | None) -> dict[str, Any]:
    """Return the fitted model as the page's fields "model", "law" and "friction", see `exploration.Model`.

    "model" has only the fields that the fit, or the fit of the stage, has identified.
    """
    from .sliders import plain, values_of

    found = {*fit.values, *(stage.values if stage is not None else ())}
    return {
        "model": {field: plain(getattr(fit.model, field)) for field in fit.model._fields if field in found},
        "law": type(fit.model.friction).__name__,
        "friction": values_of(fit.model.friction),
    }


def _advised(request: FitRequest, fit: Fit) -> dict[str, Any] | None:
    """Return the request extended by the term that the fit advises to add to the model, as a dictionary.

    It has additional free parameters, bounds and changed fields. It is None if no term is advised, or if
    several terms describe the walks equally well, because then the user must choose.
    """
    advice = fit.advice
    if advice is None or not advice.cause or advice.equal:
        return None
    more = {
        "free": list(dict.fromkeys([*request.free, *advice.added])),
        "bounds": {**request.bounds, **advice.bounds},
        "model": {**request.model, **advice.change},
    }
    return request.model_copy(update=more).model_dump()


def _correlation(fit: Fit) -> dict[str, float]:
    return {g.name: g.lag_one_correlation for g in fit.recordings}
