"""Additional analyses of a campaign, on request: posterior, profiles, comparison of models."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from ..analysis.alignment import Aligned
from ..analysis.comparison import candidates_of, named
from ..estimate.posterior import Posterior
from ..estimate.result import Fit
from ..identify.candidates import Comparison
from ..identify.walk.bayes import posterior
from ..identify.walk.compare import compare_walks
from ..identify.walk.intervals import profile_interval
from ..identify.walk.position_channel import CHANNEL
from ..progress import Progress, within
from .file import CampaignFile

_EVALUATIONS = 250  # of each search for a candidate
# Over the delay that was found: within it, other laws find theirs.
_LONGEST_DELAY = 10.0


class Additional(NamedTuple):
    """Each None where the file does not ask for it; `profiles` by parameter, 95 % intervals in its unit."""

    posterior: Posterior | None = None
    profiles: dict[str, tuple[float, float]] | None = None
    choice: Comparison | None = None


def additional(
    file: CampaignFile,
    friction: Fit,
    walks: Sequence[Aligned],
    stage: Fit | None,
    lacking: bool,
    folder: Path,
    progress: Progress,
) -> Additional:
    """What the file asks for, of a fit of friction; a choice of models too where the law is `lacking`.

    Raises:
        FitError: a fit or the sampler cannot begin, or what the sampler needs is not installed.
        QuantityError, AnalysisError: the file, in the folder, names a model that there is not.
    """
    fitted = [one for one in walks if one.use == "fit"]
    recordings = [one.recording for one in fitted]
    known: dict[str, Any] = {"drive": [one.drive for one in fitted], "slew_rate": file.known_slew_rate}
    unseen = [one for one in walks if one.use == "verify"]
    found = Additional()
    if file.profiles:
        ends = {}
        for name in (p.name for p in friction.parameters if p.name not in CHANNEL):
            progress(f"following the profile of {name}", 0.72)
            ends[name] = profile_interval(friction, recordings, name, **known)
        found = found._replace(profiles=ends)
    # A model that does not explain its recordings asks for another, whether or not the file does.
    if file.model_choice or (unseen and lacking):
        delay = friction.values.get("delay", 0.0)
        choice = compare_walks(
            recordings,
            [one.recording for one in unseen],
            friction.model,
            named(candidates_of(friction.model), file.model_choice, folder=folder),
            unseen_drive=[one.drive for one in unseen],
            begin={"delay": delay},
            bounds={"delay": (0.0, _LONGEST_DELAY * delay)} if delay > 0.0 else None,
            hops=0,
            max_evaluations=_EVALUATIONS,
            progress=partial(within, progress, 0.75, 0.1),
            **known,
        )
        found = found._replace(choice=choice)
    if file.posterior:
        doing = f"sampling the posterior, at most {file.posterior_simulations} simulations"
        progress(doing, 0.85)
        samples = posterior(
            friction,
            recordings,
            stage=stage,
            max_simulations=file.posterior_simulations,
            progress=partial(within, progress, 0.85, 0.15),
            **known,
        )
        found = found._replace(posterior=samples)
    return found
