"""Optional analyses after a campaign's friction fit: posterior, profile likelihood, comparison of models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ...estimate.disturbances import MOVES
from ...estimate.posterior import Posterior
from ...estimate.result import Fit
from ...identify.candidates import Comparison
from ...identify.walk.bayes import posterior
from ...identify.walk.compare import compare_walks
from ...identify.walk.intervals import profile_interval
from ...identify.walk.position_channel import CHANNEL
from ...quantities.progress import Progress, within
from ..analysis.alignment import Aligned
from ..analysis.comparison import candidates_of, named
from .file import CampaignFile
from .kept import Kept

if TYPE_CHECKING:
    import xarray as xr

T = TypeVar("T")

_EVALUATIONS = 250  # largest number of simulations of all walks in the fit of one law
# Upper bound of the delay in fits of other laws, as a multiple of the identified delay.
_LONGEST_DELAY = 10.0


class Additional(NamedTuple):
    """Results of the optional analyses; each is None if it was not requested or failed.

    `profiles` has the 95 % intervals of the profile likelihood by parameter, in the parameter's unit, without
    those that failed. `choice` is the comparison of models. `failures` are sentences on failed analyses.
    """

    posterior: Posterior | None = None
    profiles: dict[str, tuple[float, float]] | None = None
    choice: Comparison | None = None
    failures: tuple[str, ...] = ()


class Walked(NamedTuple):
    """Walks of a campaign: those that the friction fit used (`fitted`), and the others (`unseen`).

    `friction` is the friction fit, and `stage` the fit of the stage, None without steps.
    """

    friction: Fit
    fitted: list[Aligned]
    unseen: list[Aligned]
    stage: Fit | None

    @property
    def recordings(self) -> list[xr.Dataset]:
        """Return the recordings of the walks that the fit used."""
        return [one.recording for one in self.fitted]


def additional(
    file: CampaignFile,
    friction: Fit,
    walks: Sequence[Aligned],
    stage: Fit | None,
    lacking: bool,
    folder: Path,
    progress: Progress,
    kept: Kept,
) -> Additional:
    """Run the requested analyses of a friction fit; a failure is reported in the result, and not raised.

    Args:
        file: the campaign, which requests the analyses.
        friction: friction fit.
        walks: all walks, those of the fit and those of the verification.
        stage: fit of the stage; None without steps.
        lacking: True if the law does not explain the walks. Models are then compared without a request, if
            there are walks for verification and the cause is not known.
        folder: folder of the relative paths in the file.
        progress: called with the current activity and the finished fraction.
        kept: store of finished stages.
    """
    of = Walked(
        friction,
        [one for one in walks if one.use == "fit"],
        [one for one in walks if one.use == "verify"],
        stage,
    )
    known: dict[str, Any] = {"drive": [one.drive for one in of.fitted], "slew_rate": file.known_slew_rate}
    failures: list[str] = []
    profiles = choice = samples = None
    if file.profiles:
        profiles = {}
        for name in (p.name for p in friction.parameters if p.name not in CHANNEL):
            progress(f"following the profile of {name}", 0.72)
            profile = partial(profile_interval, friction, of.recordings, name, **known)
            of_name = partial(kept.stage, f"profile-{name}", profile)
            ends = attempted(f"the profile of {name}", of_name, failures)
            if ends is not None:
                profiles[name] = ends
    # A model that does not explain its recordings is compared with other laws even if the file does not
    # request it. No comparison is made if the cause is already known, or if a disturbance of an instrument is
    # so strong that it would decide the comparison.
    known_cause = friction.advice is not None and friction.advice.explains
    known_cause = known_cause or any(one.moves > MOVES for one in friction.disturbances)
    if file.model_choice or (of.unseen and lacking and not known_cause):
        compared = partial(_choice, file, of, folder, known, progress)
        of_laws = partial(kept.stage, "models", compared, file.model_choice)
        choice = attempted("the comparison of models", of_laws, failures)
    if file.posterior:
        progress(f"sampling the posterior, at most {file.posterior_simulations} simulations", 0.85)
        sampled = partial(
            posterior,
            friction,
            of.recordings,
            stage=stage,
            max_simulations=file.posterior_simulations,
            progress=partial(within, progress, 0.85, 0.15),
            **known,
        )
        of_all = partial(kept.stage, "posterior", sampled, file.posterior_simulations)
        samples = attempted("the posterior", of_all, failures)
    return Additional(samples, profiles, choice, tuple(failures))


def attempted(what: str, analysis: Callable[[], T], failures: list[str]) -> T | None:
    """Return the result of an analysis. On any exception append a sentence to `failures` and return None.

    Args:
        what: name of the analysis, the subject of the sentence.
        analysis: takes nothing; returns the result.
        failures: list of sentences on failures, which is extended.
    """
    try:
        return analysis()
    except Exception as error:
        # Any error is caught: the fits took long, and are valid without this analysis.
        said = str(error) if isinstance(error, ValueError) else repr(error)
        failures.append(f"{what} failed: {' '.join(said.split())}")
        return None


def _choice(
    file: CampaignFile, of: Walked, folder: Path, known: dict[str, Any], progress: Progress
) -> Comparison:
    model, delay = of.friction.model, of.friction.values.get("delay", 0.0)
    return compare_walks(
        of.recordings,
        [one.recording for one in of.unseen],
        model,
        named(candidates_of(model), file.model_choice, folder=folder),
        unseen_drive=[one.drive for one in of.unseen],
        initial={"delay": delay},
        bounds={"delay": (0.0, _LONGEST_DELAY * delay)} if delay > 0.0 else None,
        hops=0,
        max_evaluations=_EVALUATIONS,
        progress=partial(within, progress, 0.75, 0.1),
        **known,
    )
