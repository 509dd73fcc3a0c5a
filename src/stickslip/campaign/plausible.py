"""Plausibility of recordings before any fit: a walk too long for its stage, or against its drive."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np

from ..actuator import Actuator
from ..analysis.alignment import POSITION, Aligned
from ..identify.recorded.channels import channel
from ..recording import RecordingError, RecordingWarning
from ..units import unit_for, with_prefix
from ..waveform.signal import value_at

# Of position and drive of a step with the end-effector fixed: what is below it is against the drive.
INVERTED = -0.5
# Of the gain: how the position follows the drive of the other sign, at least, to be against it.
AGAINST = 0.1
# Of the median change of the drive between samples: what is above it is of an edge, where the contact slips.
SLOW = 3.0


def refuse_inverted(recordings: Sequence[Aligned], model: Actuator) -> None:
    """Raise where steps go against their drive, and name all recordings that do: a stage has a gain above 0.

    Raises:
        RecordingError: they do.
    """
    steps = [one for one in recordings if one.use == "step" and _correlation(one) < INVERTED]
    if not steps:
        return
    walks = [one for one in recordings if one.use in ("fit", "verify")]
    names = ", ".join(
        [one.name for one in (*steps, *(one for one in walks if _followed(one) < -AGAINST * abs(model.gain)))]
    )
    unit = unit_for(model, "m")
    raise RecordingError(
        f"{POSITION} [{unit}] of {names} goes down where drive_voltage [V] goes up: the sensor is inverted. "
        f'Say so in each of them, in the unit of the file: units: {{{POSITION}: "-1 u{unit}"}}'
    )


def check_walk(one: Aligned, model: Actuator) -> None:
    """Raise or warn where a walk and the model cannot belong together as they are.

    Raises:
        RecordingError: it goes further than the stage can carry it: a unit or the gain is wrong by a factor.

    Warns:
        RecordingWarning: it goes against its drive.
    """
    unit = unit_for(model, "m")
    if model.external_force == 0.0 and model.incline == 0.0:
        _refuse_beyond_reach(one.name, one.recording[POSITION].values, _drive(one), model)
    if _followed(one) / model.gain < -AGAINST:
        warnings.warn(
            f"{POSITION} [{unit}] of {one.name} goes down where drive_voltage [V] goes up: one of them is "
            f"inverted, or gain = {with_prefix(model.gain, f'{unit}/V', 4)} has the wrong sign",
            RecordingWarning,
            stacklevel=2,
        )


def _drive(one: Aligned) -> np.ndarray:
    if one.wanted is None:
        return channel(one.recording, "drive_voltage", one.name)
    return value_at(one.wanted, one.recording["time"].values)


def _correlation(one: Aligned) -> float:
    position, drive = one.recording[POSITION].values, _drive(one)
    return float(np.corrcoef(position, drive)[0, 1]) if np.ptp(position) * np.ptp(drive) > 0.0 else 0.0


def _followed(one: Aligned) -> float:
    """As `_following`, on the way forward."""
    forward = one.recording["time"].values <= (math.inf if one.forward is None else one.forward)
    return _following(one.recording[POSITION].values[forward], _drive(one)[forward])


def _refuse_beyond_reach(name: str, position: np.ndarray, drive: np.ndarray, model: Actuator) -> None:
    """The stage carries the end-effector by no more than its own way, however the contact slips.

    Twice as much is granted, and what resonance adds; a hundredth of the samples at each end may be spikes.
    """
    low, high = np.percentile(position, [1.0, 99.0])
    resonance = max(1.0, 0.5 / model.damping_ratio) if model.damping_ratio > 0 else math.inf
    reach = 2.0 * resonance * abs(model.gain) * float(np.sum(np.abs(np.diff(drive))))
    if high - low > reach:
        unit = unit_for(model, "m")
        raise RecordingError(
            f"{POSITION} [{unit}] of {name} spans {with_prefix(float(high - low), unit, 3)}, but with gain = "
            f"{with_prefix(model.gain, f'{unit}/V', 4)} its drive moves the stage by at most "
            f"{with_prefix(reach, unit, 3)}, to and fro: a unit, of position or drive, or the gain is wrong"
        )


def _following(position: np.ndarray, drive: np.ndarray) -> float:
    """How the position follows the drive, m/V, where the drive goes slowly: there the contact sticks.

    Over whole periods a walk in long steps may go against it: it gains while the drive falls back.
    """
    moves, by = np.diff(position), np.diff(drive)
    moving = np.abs(by[by != 0.0])
    slow = np.abs(by) <= SLOW * (np.median(moving) if moving.size else 0.0)
    weight = float(by[slow] @ by[slow])
    return float(moves[slow] @ by[slow]) / weight if weight > 0.0 else 0.0
