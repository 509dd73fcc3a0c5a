"""Evaluation of a campaign's recordings: scale of the sensor, stage, friction, prediction of walks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ...estimate.blas import single_threaded
from ...estimate.disturbed import lack_beside_faults
from ...estimate.influence import PriorInfluence, prior_influence
from ...estimate.lack import said
from ...estimate.result import Fit
from ...identify.recorded.screen import PositionUnderDrive, driven, refuse_inverted, refuse_walk
from ...identify.scales import scale_uncertainty
from ...identify.step.fit import identify_step, step_formula_errors
from ...identify.verification import Requirement, Verification, verify
from ...identify.walk.diagnosis import correlated, with_advice_of
from ...identify.walk.displacement import has_slopes
from ...identify.walk.explained import (
    Explained,
    contradicted,
    diagnosed_together,
    explained,
    with_minimum_of_all,
)
from ...identify.walk.friction import identify_friction
from ...identify.walk.joint import jointly
from ...identify.walk.prediction import Predictor
from ...physics.actuator import Actuator
from ...quantities.progress import Progress
from ...recording.chain import Chain
from ..analysis.alignment import POSITION, Aligned, on_level, without_drift
from .additional import Additional, additional, attempted
from .budget import ErrorBudget, Inherited, budget, inherited
from .features import features_of
from .file import CampaignFile
from .gathering import SensorScale, scale_of, scaled
from .hysteresis import Hysteresis, hysteresis_of
from .kept import Kept

if TYPE_CHECKING:
    import xarray as xr

WALKS = ("fit", "verify")
# Number of repetitions with different noise, from which the errors of the classical step formulas are found.
_REPETITIONS = 50


class CampaignResult(NamedTuple):
    """Results of a campaign.

    Attributes:
        gathered: all recordings; positions are in the scale of the reference, and a drift of the sensor is
            subtracted from walks.
        scale: scale of the sensor; None without a reference.
        stage: fit of the steps; None without steps.
        formulas: errors of the classical formulas for step responses, see `step_formula_errors`; None without
            steps.
        hysteresis: hysteresis and creep of the stage; None without recordings with `use: piezo`.
        start: actuator at which the friction fit starts, with the identified stage.
        friction: fit of the friction; it also varies the stage's parameters, within the errors of their fit,
            if there are both steps and hysteresis, and the law has derivatives.
        inherited: effect of errors of the stage, hysteresis, the scale and drifts on the friction fit; None
            without any of these, or for a law without derivatives.
        budget: error budget of the friction parameters.
        walks: recordings of `verification`, in its order.
        features: features of each walk, found without a model, by name; or the reason of their lack, a text.
        chain: signal chain from the model's position to the position channel.
        verification: prediction of all walks, those of the fit and the others.
        everything: fits to all walks; they show whether one set of values explains all of them.
        failures: sentences on unmet requirements, failed fits and analyses, and effects that the model does
            not explain.
        additional: results of the optional analyses.
        priors: effect of each prior on the friction fit; () without priors.
    """

    gathered: list[Aligned]
    scale: SensorScale | None
    stage: Fit | None
    formulas: xr.Dataset | None
    hysteresis: Hysteresis | None
    start: Actuator
    friction: Fit
    inherited: Inherited | None
    budget: ErrorBudget
    walks: list[Aligned]
    features: dict[str, xr.Dataset | str]
    chain: Chain
    verification: Verification
    everything: Explained
    failures: list[str]
    additional: Additional
    priors: tuple[PriorInfluence, ...] = ()

    @property
    def widened_stage(self) -> Fit | None:
        """Return the fit of the steps, with intervals widened by the errors of hysteresis and creep.

        It is None without steps, and the plain fit without recordings of hysteresis.
        """
        if self.stage is None or self.hysteresis is None:
            return self.stage
        return self.hysteresis.widened(self.stage)


@single_threaded
def evaluate(
    file: CampaignFile,
    model: Actuator,
    gathered: Sequence[Aligned],
    progress: Progress,
    folder: Path = Path(),
    kept: Kept = Kept(),  # noqa: B008  # immutable
) -> CampaignResult:
    """Identify sensor scale, stage and friction in turn, and verify the model on all walks.

    Args:
        file: the campaign.
        model: actuator with the initial values of the fits.
        gathered: recordings of the campaign, aligned with their drives.
        progress: called with the current activity and the finished fraction.
        folder: folder of the relative paths in the file.
        kept: store of finished stages, from which an interrupted campaign resumes; by default none.

    Raises:
        RecordingError: a recording is not suitable.
        FitError, QuantityError: a fit has no valid start, or the file names something that does not exist.
    """
    requirements = [Requirement.parse(text) for text in file.require]
    recordings = list(gathered)
    scale, rate = None, file.known_slew_rate
    if file.reference is not None:
        steps = [one for one in recordings if one.use == "step"]
        scale = scale_of(steps, file.reference, file.settling)
        share = scale_uncertainty([one.recording for one in steps], file.reference)
        recordings = [scaled(one, scale.value, share) for one in recordings]
    recordings = [without_drift(one) if one.use in WALKS else one for one in recordings]
    _refuse_inverted(recordings, model)
    hysteresis, stage, formulas, model = _stage(file, recordings, model, progress, kept)
    progress("identifying the friction", 0.2)
    walks = [on_level(one, model) for one in recordings if one.use in WALKS]
    for one in walks:
        refuse_walk(moved(one), model)
    fitted = [one for one in walks if one.use == "fit"]
    of_one = partial(_friction, file, fitted, model, stage, diagnose=len(walks) == len(fitted))
    alone = friction = kept.stage("friction", of_one)
    widened = stage
    if hysteresis is not None and stage is not None:
        widened = hysteresis.widened(stage)
        if has_slopes(friction.model):
            progress("identifying friction and stage at once", 0.6)
            data, drives = [one.recording for one in fitted], [one.drive for one in fitted]
            at_once = partial(jointly, alone, data, drives, widened, rate, model, file.hops)
            friction = kept.stage("friction-and-stage", at_once)
    stages = () if hysteresis is None else hysteresis.stages
    everything = Explained(friction, friction, friction.lack)
    if len(walks) > len(fitted):
        everything = kept.stage("all-walks", partial(_explained, file, alone, walks, stage, stages))
    if friction is alone:
        alone = friction = _in_the_minimum_of_all(file, alone, everything, fitted, stage, kept)
    progress("predicting", 0.7)
    chain = Chain(friction.values["delay"], 0.0, scale.value if scale else 1.0, file.slew_rate, zeroed=True)
    predictor = Predictor(friction.model, chain)
    verification = verify(
        predictor,
        [one.recording for one in walks],
        drive=[one.drive for one in walks],
    )
    lacking = dict.fromkeys(said((*friction.lack, *everything.lacks)))
    if len(walks) > len(fitted) and (lacking or correlated(everything.known)):
        progress("looking for what the model lacks", 0.71)
        together = kept.stage("advice", partial(_advised, file, everything, walks))
        alone, friction = (with_advice_of(one, together) for one in (alone, friction))
    law_lacks = bool(said((*lack_beside_faults(friction), *everything.lacks_beside_faults)))
    also = stage or scale or stages or any(one.drift for one in fitted)
    taken = inherited(friction, fitted, widened, rate, stages) if also else None
    more = additional(file, alone, walks, stage, law_lacks, folder, progress, kept)
    failed = [*more.failures]
    influence = partial(_influence, file, fitted, model, stage, alone)
    priors = attempted("the fit without priors", partial(kept.stage, "priors", influence), failed)
    return CampaignResult(
        recordings,
        scale,
        stage,
        formulas,
        hysteresis,
        model,
        friction,
        taken,
        budget(friction, taken, scale),
        walks,
        features_of(walks),
        chain,
        verification,
        everything,
        [
            *verification.unmet(requirements),
            *dict.fromkeys([*(stage.failures if stage else ()), *friction.failures, *lacking]),
            *failed,
        ],
        more._replace(failures=tuple(failed)),
        priors or (),
    )


def moved(one: Aligned) -> PositionUnderDrive:
    """Return times, position and drive of a recording, as the plausibility checks `refuse_walk` take them."""
    position, name = one.recording[POSITION], one.name
    unit = str(position.attrs.get("units", "") or "m")
    drive = driven(one.recording, one.wanted, name)
    return PositionUnderDrive(name, POSITION, unit, one.recording["time"].values, position.values, drive)


def _refuse_inverted(recordings: Sequence[Aligned], model: Actuator) -> None:
    steps = [moved(one) for one in recordings if one.use == "step"]
    refuse_inverted(steps, [moved(one) for one in recordings if one.use in WALKS], model)


class _Stage(NamedTuple):
    """Identified stage of a campaign.

    `hysteresis`, `fit` and `formulas` are as `hysteresis`, `stage` and `formulas` of `CampaignResult`.
    `model` is the initial actuator with the identified parameters of the stage.
    """

    hysteresis: Hysteresis | None
    fit: Fit | None
    formulas: xr.Dataset | None
    model: Actuator


def _stage(
    file: CampaignFile, recordings: Sequence[Aligned], model: Actuator, progress: Progress, kept: Kept
) -> _Stage:
    """Identify hysteresis and creep, then the vibration mode, as far as recordings for them exist.

    The alternative stages of the hysteresis get the vibration mode that the steps give with them, and the
    errors of formulas for the step response are computed.

    Args:
        file: the campaign.
        recordings: all recordings of the campaign.
        model: actuator with initial values.
        progress: called with the current activity and the finished fraction.
        kept: store of finished stages of the computation.

    Returns:
        The identified stage. Without recordings of a piezo its `hysteresis` is None; without steps its `fit`
        and `formulas` are None.
    """
    hysteresis = None
    if any(one.use == "piezo" for one in recordings):
        progress("identifying hysteresis and creep", 0.0)
        hysteresis = kept.stage("hysteresis", partial(hysteresis_of, file, recordings, model))
        model = hysteresis.fit.model
    steps = [one.recording for one in recordings if one.use == "step"]
    if not steps:
        return _Stage(hysteresis, None, None, model)
    progress("identifying the stage", 0.1)

    def of_steps(of: Actuator) -> Fit:
        return identify_step(steps, of, filter=file.filter, slew_rate=file.known_slew_rate)

    fit = kept.stage("stage", partial(of_steps, model))
    if hysteresis is not None:
        hysteresis = kept.stage("hysteresis-of-stages", partial(hysteresis.refitted, of_steps))
    formulas = kept.stage("formulas", partial(step_formula_errors, fit, steps, n=_REPETITIONS))
    return _Stage(hysteresis, fit, formulas, fit.model)


def _influence(
    file: CampaignFile, fitted: Sequence[Aligned], model: Actuator, stage: Fit | None, friction: Fit
) -> tuple[PriorInfluence, ...]:
    """Return the effect of each prior on the friction fit, by comparison with a new fit without priors.

    The result is () if the file has no priors.

    Args:
        file: the campaign.
        fitted: walks with 'use: fit'.
        model: actuator with the identified stage, at which the fit starts.
        stage: fit of the stage; None without steps.
        friction: friction fit with the priors.
    """
    if not file.priors:
        return ()
    alone = _friction(file.model_copy(update={"priors": {}}), fitted, model, stage, diagnose=False)
    return prior_influence(alone, friction)


def _friction(
    file: CampaignFile,
    fitted: Sequence[Aligned],
    model: Actuator,
    stage: Fit | None,
    *,
    diagnose: bool = True,
) -> Fit:
    return identify_friction(
        [one.recording for one in fitted],
        model,
        [*file.free, "delay", "offset"],
        drive=[one.drive for one in fitted],
        initial=None if stage is None else {"delay": stage.values["delay"]},
        bounds=file.bounds,
        priors=file.priors,
        slew_rate=file.known_slew_rate,
        diagnose=diagnose,
        **file.arguments,
    )


def _explained(
    file: CampaignFile, friction: Fit, walks: Sequence[Aligned], stage: Fit | None, stages: Sequence[Actuator]
) -> Explained:
    return explained(
        friction,
        [one.recording for one in walks],
        [one.drive for one in walks],
        file.free,
        stage=stage,
        stages=stages,
        slew_rate=file.known_slew_rate,
        bounds=file.bounds,
    )


def _in_the_minimum_of_all(
    file: CampaignFile,
    alone: Fit,
    everything: Explained,
    fitted: Sequence[Aligned],
    stage: Fit | None,
    kept: Kept,
) -> Fit:
    """Return the friction fit; if it is in another local minimum than the fit to all walks, a corrected one.

    If the values of the fit to all walks are far outside the intervals of the friction fit, the latter is
    repeated with these values as the initial guess. The comparison of both decides, see
    `with_minimum_of_all`.

    Args:
        file: the campaign.
        alone: friction fit to the walks with 'use: fit'.
        everything: fits to all walks.
        fitted: walks with 'use: fit'.
        stage: fit of the stage; None without steps.
        kept: store of finished stages.
    """
    if not contradicted(alone, everything):
        return alone
    near = file.model_copy(update={"hops": 0})
    begun = partial(_friction, near, fitted, everything.known.model, stage, diagnose=False)
    return with_minimum_of_all(alone, kept.stage("other-minimum", begun))


def _advised(file: CampaignFile, found: Explained, walks: Sequence[Aligned]) -> Fit:
    """Return the fit to all walks with advice: the term whose addition to the model best explains the
    walks."""
    return diagnosed_together(
        found,
        [one.recording for one in walks],
        [one.drive for one in walks],
        file.free,
        slew_rate=file.known_slew_rate,
        bounds=file.bounds,
    )
