"""Fields of new identification files for recordings without a walk: friction loops, or a piezo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .entries import DRIVE, MOVED, Inspected, entry_of, listed, shown_value

WALK, LOOPS, PIEZO = "identification", "friction_loops", "piezo"
STAGE = ("stage_position", "piezo_elongation")
_CONTACT = ("position", "friction_force")
# _FITTED: fraction of a single recording that is fitted; the rest is predicted. _YIELDS: fraction of the
# stroke over which the contact is assumed to stick, for the initial stiffness.
_FITTED, _YIELDS = 0.6, 0.03

Array = NDArray[np.float64]


def measured_kind(seen: list[Inspected]) -> str:
    """Return the kind of fit that the channels of all recordings allow: `LOOPS`, `PIEZO` or `WALK`.

    `WALK` is also returned if channels are missing, so that the new file names the missing ones.
    """
    channels = [set(map(str, one.found.recording)) for one in seen]  # type: ignore[arg-type]
    if all(DRIVE not in one and one.issuperset(_CONTACT) for one in channels):
        return LOOPS
    if all(DRIVE in one and MOVED not in one for one in channels) and _observed(seen):
        return PIEZO
    return WALK


def loops(seen: list[Inspected], folder: Path) -> tuple[dict[str, str], list[str]]:
    """Return the texts that fill the template for friction loops, by field, and an empty list.

    The list would name missing data. Among the texts are the entries of the recordings (a single recording is
    split into two parts), and initial values of the laws, estimated from the first recording.
    """
    recording: Any = seen[0].found.recording
    position, friction = (recording[name].values for name in _CONTACT)
    force = 0.5 * float(np.ptp(friction)) or 1.0
    stiffness = force / (_YIELDS * float(np.ptp(position)) or 1.0)
    # Values without units are in SI, for rotary contacts N m and N m/rad.
    turns = recording["position"].attrs["units"] == "rad"
    units = ("", "") if turns else ("N", "N/m")
    values = {"force": force, "half": 0.5 * force}, {"stiffness": stiffness, "stiffer": 1.5 * stiffness}
    starts = {
        name: shown_value(value, unit) if unit else f"{value:.3g}"
        for unit, group in zip(units, values, strict=True)
        for name, value in group.items()
    }
    flip = "flip: true # the force of this recording is against the motion that it should go with"
    return {
        **starts,
        "flip": flip if _against(position, friction) else "# flip: true # turns the sign of the force",
        "reference": _reference(seen),
        "recordings": "\n".join(_halves(seen[0], folder) if len(seen) == 1 else _fitted_first(seen, folder)),
    }, []


def piezo(seen: list[Inspected], folder: Path) -> tuple[dict[str, str], list[str]]:
    """Return the texts that fill the template for a piezo, by field, and an empty list.

    The list would name missing data. The texts are the entries of the recordings, and the name of the channel
    that shows the displacement.
    """
    return {"observed": _observed(seen), "recordings": "\n".join(_fitted_first(seen, folder))}, []


def _observed(seen: list[Inspected]) -> str:
    return next((name for name in STAGE if all(name in (one.found.recording or ()) for one in seen)), "")


def _fitted_first(seen: list[Inspected], folder: Path) -> list[str]:
    """Return the entries of recordings as texts: the first one is to be fitted, the others predicted."""
    return [listed(entry_of(one, folder, "verify" if i else "fit", ())[0]) for i, one in enumerate(seen)]


def _halves(one: Inspected, folder: Path) -> list[str]:
    """Return two entries of one recording as texts: its first part is to be fitted, the rest predicted.

    The parts meet at `_round_between` of its times.
    """
    at = _round_between(one.found.recording["time"].values)  # type: ignore[index]
    parts = {"fit": f"name: first part, end: {at:.9g} s", "verify": f"name: last part, start: {at:.9g} s"}
    return [listed([*said.split(", "), *entry_of(one, folder, use, ())[0]]) for use, said in parts.items()]


def _round_between(time: Array) -> float:
    """Return a time with few digits near `_FITTED` of a recording's length, s.

    `time` are the times of the samples. The result differs from the exact time by at most 5 % of the length.
    """
    length = float(time[-1] - time[0])
    at = float(time[0]) + _FITTED * length
    roundings = (float(f"{at:.{digits}g}") for digits in range(1, 9))
    return next((one for one in roundings if abs(one - at) <= 0.05 * length), at)


def _against(position: Array, friction: Array) -> bool:
    """Return True if the friction force (or torque) does negative work along the position.

    Such a force is that on the other body, so its sign must be changed.
    """
    force = friction - np.mean(friction)
    return float(np.sum(np.diff(position) * (force[1:] + force[:-1]))) < 0.0


def _reference(seen: list[Inspected]) -> str:
    recordings: list[Any] = [one.found.recording for one in seen]
    loads = [one["normal_force"].values for one in recordings if "normal_force" in one]
    mean = float(np.mean(loads[0])) if len(loads) == len(seen) else 0.0
    if mean > 0.0:
        return (
            f"reference_normal_force: {shown_value(mean, 'N')} # the mean; the forces of the laws hold there"
        )
    return "# reference_normal_force: 5 N # with normal_force in all recordings, which the forces then follow"
