"""Origin of a model's values that were not fitted: a parameter set, possibly of another actuator."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, NamedTuple

from ..parameters import available_sets, bibtex, citation_keys, load_set, unchanged
from ..physics.actuator import Actuator, load_actuator
from ..quantities.records import quantities

if TYPE_CHECKING:
    import xarray as xr

# Fields of an actuator that limit the allowed voltage; they have no effect on a simulated motion.
_LIMITS = ("min_voltage", "max_voltage")


class Origin(NamedTuple):
    """Assumptions on values of a model that were not fitted ("field = words"), and BibTeX of the sources."""

    assumptions: list[str]
    citations: str


def origin_of(model: Actuator, recordings: Iterable[xr.Dataset], fitted: Collection[str] = ()) -> Origin:
    """Return the origin of a model's values that were not fitted, for a report on recordings.

    If all recordings name the model's parameter set, as those of a virtual rig and of simulations do, or if
    the set is not of this package, the set's assumptions are listed. Otherwise the set belongs to another
    actuator: then each value that was taken from it and affects the motion is listed as an assumption.

    Args:
        model: actuator whose `name` is the name of its parameter set.
        recordings: all recordings that were fitted or predicted.
        fitted: names of fitted values, such as "gain" or "friction.sigma_0"; for friction also "sigma_0".
    """
    inner = quantities(type(model.friction))
    found = {f"friction.{name}" if name in inner else name for name in fitted} | set(fitted)
    named = [f"{one.attrs.get('actuator')} {one.attrs.get('model')}" for one in recordings]
    theirs = all(f"name={model.name!r}" in one for one in named)
    if theirs or model.name not in available_sets():
        said = [f"{field} = {words}" for field, words in model.assumptions.items() if field not in found]
        return Origin(said, model.citation)
    taken = {
        field: words
        for field, words in unchanged(model, load_actuator(model.name), load_set(model.name)).items()
        if field not in found and not _of_any(model, field)
    }
    reason = f"taken over from the parameter set {model.name}, which is of another actuator"
    said = [f"{field} = {words}: {reason}{_scaled(model, field)}" for field, words in taken.items()]
    law = citation_keys(model.friction)
    if not taken:
        return Origin(said, bibtex(*law))
    comment = f"% Of the parameter set {model.name}, which is of another actuator: {', '.join(taken)}."
    return Origin(said, f"{bibtex(*model.citation_keys)}\n\n{comment}")


def _of_any(model: Actuator, field: str) -> bool:
    """Return True if the value of a field needs no source in a report.

    No simulated motion depends on the voltage limits, on a Stribeck velocity with equal static and Coulomb
    friction, or on a stage mass without reaction of the friction on the stage. This reaction itself occurs in
    any real actuator.
    """
    law = model.friction
    if field == "friction.stribeck_velocity":
        return getattr(law, "stiction_force", None) == getattr(law, "coulomb_force", None)
    return field in _LIMITS or (field == "stage_reaction" if model.stage_reaction else field == "stage_mass")


def _scaled(model: Actuator, field: str) -> str:
    """Return the end of a sentence on the effect of an assumed end-effector mass; "" for other fields.

    If the friction does not act back on the stage (`stage_reaction` is False), a motion depends only on the
    ratios of friction force and stiffness to the mass. So the fitted friction is proportional to the mass.
    """
    if field != "end_effector_mass" or model.stage_reaction:
        return ""
    return "; the friction that is found, forces and stiffness, is in proportion to it"
