"""Check of a campaign file: names and parameters, before anything is recorded or computed."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path

from ...identify.verification import Requirement
from ...identify.walk.asked import check_asked
from ...physics.actuator import Actuator
from ...quantities.input_file import InputFileError
from ...quantities.records import did_you_mean
from ..analysis.comparison import candidates_of, checked_laws
from .file import CampaignFile, CellsSpec


def check_campaign(file: CampaignFile, folder: Path, cells: Sequence[str]) -> Actuator:
    """Check a campaign's model, parameters, requirements, laws and names; return the initial model.

    Args:
        file: the campaign.
        folder: folder of its relative paths.
        cells: names of the recordings that the experiment makes; [] without one.

    Raises:
        QuantityError: a parameter cannot be free; or a bound, a prior, a requirement or a law is wrong.
        InputFileError: no recording matches a pattern, two recordings have the same name, or `published`
            names an unknown recording; or a law to compare is unknown.
        ParameterSetError: the model does not exist.
    """
    model = file.load_model(folder)
    for text in file.require:
        Requirement.parse(text)
    checked_laws(candidates_of(model), file.model_choice, model, folder, "model_choice")
    asked = {"bounds": file.bounds, "priors": file.priors, "tied": file.tied, "noise": file.noise}
    check_asked(model, [*file.free, "delay", "offset"], **asked)
    names, left = list[str](), list(cells)
    for i, spec in enumerate(file.recordings):
        if not isinstance(spec, CellsSpec):
            names.append(spec.label)
            continue
        fitting = [name for name in left if fnmatchcase(name, spec.cells)]
        if not fitting:
            there = ", ".join(left[:10]) or "none"
            raise InputFileError(
                f"recordings.{i}: no cell that is left fits {spec.cells!r}; left are {there}"
            )
        left = [name for name in left if name not in fitting]
        names += fitting
    for name in names:
        if names.count(name) > 1:
            raise InputFileError(f"recordings: two are called {name!r}; give each a 'name'")
    known = ["step", *names]
    for name in file.published:
        if name not in known:
            raise InputFileError(
                f"published: there is no recording {name!r}{did_you_mean(name, known)}; "
                f"there are {', '.join(known)}"
            )
    return model
