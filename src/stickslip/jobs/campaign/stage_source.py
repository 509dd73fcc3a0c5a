"""Sentences of the report on the origin of the stage's parameters.

They come from step responses, from the friction fit, from recordings of hysteresis (the gain only), or from
the initial model; then they are taken as known.
"""

from __future__ import annotations

from ...identify.step.fit import STAGE_PARAMETERS
from .budget import freed
from .evaluation import CampaignResult
from .file import CampaignFile

# Headings of the stage's errors in the error budget: stage identified from steps, or by the friction fit.
FROM_STEPS, FITTED_TOO = "stage from the steps", "stage from the friction fit"
_OTHERS = "The stage's other parameters"


def stage_words(file: CampaignFile, found: CampaignResult) -> str:
    """Return sentences on the origin of the stage's parameters, and on their errors.

    They state whether these errors are part of the intervals of the friction parameters.
    """
    own = _asked_for(file)
    rest = [name for name in STAGE_PARAMETERS if name not in own]
    said = [f"The friction fit also identifies the stage's {_listed(own)}."] if own else []
    what = _OTHERS if own else "The stage's parameters"
    if not rest:
        return said[0]
    if _held_by_steps(file, found):
        said.append(f"{what} come from the step responses; the friction fit varies them within their errors.")
    elif found.stage is not None:
        said.append(f"{what} come from the step responses, {_counted(_errors_of_steps(found))}.")
    else:
        said += _without_steps(found, rest, what)
    return " ".join(said)


def _without_steps(found: CampaignResult, rest: list[str], what: str) -> list[str]:
    """Return sentences on the origin of the stage's parameters, for a campaign without recordings of steps.

    Args:
        found: result of the campaign.
        rest: names of the stage's parameters that the friction fit does not identify.
        what: words for these parameters, the subject of the sentences.
    """
    said = []
    if found.hysteresis is not None and "gain" in rest:
        rest, what = [name for name in rest if name != "gain"], _OTHERS
        of = found.inherited is not None and found.inherited.others is not None
        said.append(f"The stage's gain comes from the recordings of hysteresis and creep, {_counted(of)}.")
    if rest:
        said.append(
            f"{what} are taken as known, because there are no recordings of steps: the uncertainty of "
            f"{_listed(rest)} is not part of the intervals."
        )
    return said


def stage_heading(file: CampaignFile, found: CampaignResult, source: str) -> str:
    """Return the heading of a source of errors in the table of the error budget.

    It is the name `source`, with one exception: if the friction fit itself identified parameters of the
    stage, without information from steps, "stage from the steps" (`FROM_STEPS`) becomes `FITTED_TOO`.
    """
    is_own = source == FROM_STEPS and freed(found.friction) and not _held_by_steps(file, found)
    return FITTED_TOO if is_own else source


def band_words(file: CampaignFile, found: CampaignResult, *, drawn: bool) -> str:
    """Return words on the sources of error that prediction bands contain, for the caption of a figure.

    `drawn` is False if the friction law has no derivatives; the bands then contain only the noise of the fit.
    """
    if not drawn:
        return (
            "the noise of the fit alone: errors of parameters need derivatives, which this law does not have"
        )
    rest = [name for name in STAGE_PARAMETERS if name not in _asked_for(file)]
    if _held_by_steps(file, found) or not rest or _errors_of_steps(found):
        return "the errors of all parameters, including the stage's, and the noise of the fit"
    return "the errors of the fitted parameters and the noise of the fit; other parameters are taken as exact"


def _asked_for(file: CampaignFile) -> list[str]:
    """Return the names of the stage's parameters that the file makes free or tied in the friction fit."""
    return [name for name in STAGE_PARAMETERS if name in (*file.free, *(file.tied or ()))]


def _held_by_steps(file: CampaignFile, found: CampaignResult) -> bool:
    """Return True if the stage's parameters were free in the friction fit, with the steps as a prior.

    Such a fit has free stage parameters that the file does not request.
    """
    names = {found.friction.parameters[i].name for i in freed(found.friction)}
    return found.stage is not None and bool(names - {*_asked_for(file)})


def _errors_of_steps(found: CampaignResult) -> bool:
    return found.inherited is not None and found.inherited.stage is not None


def _counted(included: bool) -> str:
    return f"whose errors are {'' if included else 'not '}part of the intervals"


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
