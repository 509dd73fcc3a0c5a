"""Checks of recordings and of fitted values: pure noise, swapped columns, a wrong sign, a wrong unit.

A fit cannot explain such a recording, or explains it by values that are wrong by the same factor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ...quantities.units import unit_for, with_prefix
from ...recording import STANDARD_NAMES, RecordingError
from ...recording.noise import noise_level
from ...waveform.signal import Waveform, value_at
from .channels import EDGE, channel
from .levels import converter_step

if TYPE_CHECKING:
    import xarray as xr

# Probability that white noise in one recording is taken for a signal.
FALSE_ALARM = 1e-3
FEWEST = 64  # fewest samples of a channel that is tested for pure noise
# Fewest blocks of samples over which means are taken in the test for pure noise; the scatter of fewer means
# does not distinguish noise from a signal.
FEWEST_BLOCKS = 8
# Largest and smallest possible gain of a piezo stage, m/V (rad/V). The largest is ten times that of amplified
# stages; the smallest a third of the value of the weakest piezo ceramics (d31 of hard PZT, one layer). Wrong
# units differ by a factor of 1000.
LARGEST_GAIN, SMALLEST_GAIN = 1e-4, 3e-11
# Largest ratio of the ranges of position and drive, m/V. A larger ratio means that the columns are swapped.
SWAPPED_GAIN = 1.0
# Ratio of two sizes above which a unit is taken to be wrong: about the square root of 1000, the usual error.
FACTOR = 30.0
UNSURE = 5.0  # factor by which the gain of the stage may be wrong before it is identified
# Smallest slope of the position against the drive, as a share of the gain, at which the sensor is inverted.
AGAINST = 0.2
# Correlation of the position with the inverted drive above which the sensor is inverted. It is computed for a
# step with fixed end-effector, or where the drive of a walk is slow. A sliding contact may lag by a quarter
# period.
INVERTED = 0.5
# Number of standard errors above which a slope of the position, or the work of a loop, is not noise.
SURE = 5.0
CORRELATED = 3.5  # number of standard errors above which a correlation with the drive is not noise
# Largest change of the drive between samples in a slow part, in medians of all changes. A larger change
# belongs to an edge, at which the contact slips.
SLOW = 3.0
# Smallest ratio of the natural frequency to the angular frequency of a slow part of the drive; the stage does
# not follow faster parts.
SLOWER = 10.0
# Share of the samples of a slow part that is used, at its end; before, the contact may still settle after a
# slip.
SETTLED = 0.75
FEWEST_IN_PART = 8  # fewest samples of a slow part
# Smallest negative work of loops at which the sign is wrong, as a share of half the range of the force times
# the path.
LOST = 0.05

Array = NDArray[np.float64]


class PositionUnderDrive(NamedTuple):
    """Position under a drive, for the checks.

    Fields: `name` of the recording; name of the position `channel`; `unit` of the position; `time` [n], s;
    `position` [n]; `drive` [n], V.
    """

    name: str
    channel: str
    unit: str
    time: Array
    position: Array
    drive: Array

    @property
    def label(self) -> str:
        """Return channel, unit and recording as a label for messages."""
        return f"{self.channel} [{self.unit}] of {self.name}"


def driven(recording: xr.Dataset, drive: Waveform | None, where: str) -> Array:
    """Return the drive at the samples of a recording, V, shape (n,), from the waveform `drive` or, if that is
    None, from the channel drive_voltage; `where` names the recording in errors."""
    if drive is None:
        return channel(recording, "drive_voltage", where)
    return value_at(drive, recording["time"].values)


def refuse_noise(values: Array, name: str, where: str, drive: Array | None = None) -> None:
    """Raise RecordingError if a channel is only white noise and does not follow its drive.

    A channel of fewer than `FEWEST` samples passes. `values` and `drive` have the shape (n,); `name` and
    `where` name channel and recording in the error.
    """
    if values.size < FEWEST or _stands_out(values) or (drive is not None and _correlated(values, drive)):
        return
    meaning = STANDARD_NAMES.get(name)
    unit = meaning.unit if meaning else ""
    raise RecordingError(
        f"{name} [{unit}] of {where} is nothing but noise, {with_prefix(float(np.std(values)), unit, 3)} "
        "rms: it shows no motion. Check the sensor, its range, and which column is read"
    )


def _stands_out(values: Array) -> bool:
    """Return True if values [n] contain more than white noise: a pulse, a spectral line, or slow motion.

    Means over blocks of 2, 4, 8, ... samples of white noise have a standard deviation smaller by the root of
    the block size.
    """
    x = values - values.mean()
    variance = float(np.mean(x**2))
    share = FALSE_ALARM / 3.0
    noise = max(noise_level(x), converter_step(values) / math.sqrt(12.0))
    if float(np.max(np.abs(x))) > math.sqrt(2.0 * math.log(2.0 * x.size / share)) * noise:
        return True
    power = np.abs(np.fft.rfft(x)[1 : (x.size + 1) // 2]) ** 2
    if float(power.max()) > math.log(power.size / share) * float(power.mean()):
        return True
    scales = int(math.log2(x.size / FEWEST_BLOCKS))
    for size in 2 ** np.arange(1, scales + 1):
        count = x.size // int(size)
        means = x[: count * size].reshape(count, size).mean(axis=1)
        if scipy.special.chdtrc(count - 1, count * size * float(np.var(means)) / variance) < share / scales:
            return True
    return False


def _correlated(values: Array, drive: Array) -> bool:
    """Return True if values [n] are correlated with a drive [n] more than white noise is."""
    u, x = drive - drive.mean(), values - values.mean()
    power = float(u @ u)
    return power > 0.0 and abs(float(u @ x)) > CORRELATED * float(np.std(x)) * math.sqrt(power)


def refuse_swapped(one: PositionUnderDrive) -> None:
    """Raise RecordingError if positions and volts are swapped, that is if the range of the position over that
    of the drive exceeds 1 m/V (rad/V)."""
    moved, driven = float(np.ptp(one.position)), float(np.ptp(one.drive))
    if moved > SWAPPED_GAIN * driven > 0.0:
        raise RecordingError(
            f"{one.label} spans {with_prefix(moved, one.unit, 3)} while drive_voltage [V] spans "
            f"{with_prefix(driven, 'V', 3)}: the columns are swapped, or a unit is wrong. Say which column "
            "is which (`columns`)"
        )


def said_gain(gain: float, unit: str, known: float | None = None) -> tuple[str, ...]:
    """Return a tuple with one sentence if a gain [unit/V] is negative, impossible for a piezo stage, or
    different from the `known` gain by more than a factor `FACTOR`; otherwise an empty tuple."""
    shown = with_prefix(gain, f"{unit}/V")
    if gain < 0.0:
        return ("the position falls where the voltage rises: mirror the channel, or the drive",)
    if gain > LARGEST_GAIN:
        return (f"gain = {shown}: no piezo stage moves so far; are the units right?",)
    if 0.0 < gain < SMALLEST_GAIN:
        return (f"gain = {shown}: every piezo moves further; are the units right?",)
    if known and not 1.0 / FACTOR <= gain / abs(known) <= FACTOR:
        before = with_prefix(abs(known), f"{unit}/V")
        return (f"gain = {shown}, and the model that was given has {before}: are the units right?",)
    return ()


def refuse_walk(one: PositionUnderDrive, model: Any) -> None:
    """Raise RecordingError if a walk and its model (an actuator) cannot belong together.

    A model with an external force or an incline is only checked for the first two errors below, because a
    load can move the end-effector any distance.

    Raises:
        RecordingError: the position is noise, swapped with the drive, farther than the stage can carry it,
            far smaller than the stage's motion, or against the drive.
    """
    refuse_noise(one.position, one.channel, one.name, one.drive)
    refuse_swapped(one)
    if model.external_force != 0.0 or model.incline != 0.0:
        return
    _refuse_beyond_reach(one, model)
    found = following(one, _slowest(model))
    if found is None:
        return
    slope, error = found.slope / model.gain, found.error / abs(model.gain)
    against = -found.correlation if model.gain > 0.0 else found.correlation
    if slope < -AGAINST and slope < -SURE * error and against > INVERTED:
        raise RecordingError(
            f"{said_inverted(one.label, one)}; or gain = {_gain(model)} of the model has the wrong sign"
        )
    stroke = abs(model.gain) * float(np.ptp(one.drive))
    spans = _span(one.position)
    if abs(slope) + SURE * error < 1.0 / FACTOR and spans < stroke / FACTOR:
        raise RecordingError(
            f"{one.label} spans {with_prefix(spans, one.unit, 3)}, but with gain = {_gain(model)} its drive "
            f"moves the stage by {with_prefix(stroke, one.unit, 3)}, and slowly: a unit, of position or "
            "drive, or the gain is wrong"
        )


def refuse_inverted(
    steps: Sequence[PositionUnderDrive], walks: Sequence[PositionUnderDrive], model: Any
) -> None:
    """Raise RecordingError if the position of any step moves against its drive; the message names all such
    recordings, walks included. Walks alone do not raise the error.

    Args:
        steps: step recordings, with the end-effector fixed to the stage.
        walks: walks recorded with the same sensor.
        model: actuator, whose gain is above 0.
    """
    inverted = [one for one in steps if _correlation(one) < -INVERTED]
    if not inverted:
        return
    for one in walks:
        found = following(one, _slowest(model))
        if found is not None and found.slope < -AGAINST * abs(model.gain):
            inverted.append(one)
    first = inverted[0]
    names = ", ".join(one.name for one in inverted)
    raise RecordingError(said_inverted(f"{first.channel} [{first.unit}] of {names}", first))


def refuse_against(one: PositionUnderDrive) -> None:
    """Raise RecordingError if the correlation of a piezo's position with its voltage is negative."""
    if _correlation(one) < 0.0:
        raise RecordingError(said_inverted(one.label, one))


def said_inverted(label: str, one: PositionUnderDrive) -> str:
    """Return a sentence on positions that move against their drive, with the setting of the file that inverts
    the sensor; `label` names channel and recordings."""
    return (
        f"{label} goes down where drive_voltage [V] goes up: the sensor is inverted. Say so, in the unit of "
        f'the file: units: {{{one.channel}: "-1 u{one.unit}"}}'
    )


def _correlation(one: PositionUnderDrive) -> float:
    position, drive = one.position, one.drive
    return float(np.corrcoef(position, drive)[0, 1]) if np.ptp(position) * np.ptp(drive) > 0.0 else 0.0


class Following(NamedTuple):
    """Linear relation of a position to its drive: `slope` [unit of the position per V], the standard `error`
    of the slope by white noise, and the `correlation` (-1 to 1) without the effect of white noise."""

    slope: float
    error: float
    correlation: float


def following(one: PositionUnderDrive, natural_frequency: float) -> Following | None:
    """Return the relation of the position to the drive in the slow parts of the drive; None if no part is
    slow.

    The contact sticks in these parts. Over whole periods a walk in long steps may move against its drive: it
    advances while the drive falls back.

    Args:
        one: the walk.
        natural_frequency: lowest natural frequency, rad/s, from which slow parts are judged.
    """
    change = np.abs(np.diff(one.drive))
    moving = change[change > 0.0]
    if not moving.size:
        return None
    edge = max(SLOW * float(np.median(moving)), EDGE * float(np.ptp(one.drive)))
    ends = np.flatnonzero(change > edge) + 1
    interval, noise = float(np.median(np.diff(one.time))), noise_level(one.drive)
    power, common, moved, count = 0.0, 0.0, 0.0, 0
    for u, x in zip(np.split(one.drive, ends), np.split(one.position, ends), strict=True):
        if u.size < FEWEST_IN_PART:
            continue
        late = slice(u.size - int(SETTLED * u.size), u.size)
        v = u[late] - u[late].mean()
        square = float(v @ v)
        if square <= 4.0 * v.size * noise**2:
            continue
        # The rate of this part is its angular frequency, in rad per sample, if the drive is a sine there; for
        # a ramp, the rate is 3.5 divided by its number of samples.
        rate = math.sqrt(max(float(np.sum(np.diff(v) ** 2)) - 2.0 * v.size * noise**2, 0.0) / square)
        if rate / interval < natural_frequency / SLOWER:
            power, common = power + square, common + float(v @ x[late])
            moved, count = moved + float(x[late].var()) * v.size, count + v.size
    if not power > 0.0:
        return None
    white = noise_level(one.position)
    moved = max(moved - count * white**2, common**2 / power)
    return Following(common / power, white / math.sqrt(power), common / math.sqrt(power * moved or 1.0))


def _refuse_beyond_reach(one: PositionUnderDrive, model: Any) -> None:
    """Raise RecordingError if a position moves farther than the stage can carry it, however the contact
    slips.

    The limit allows for resonance, and for a gain that is not yet identified.
    """
    resonance = max(1.0, 0.5 / model.damping_ratio) if model.damping_ratio > 0 else math.inf
    reach = UNSURE * resonance * abs(model.gain) * float(np.sum(np.abs(np.diff(one.drive, prepend=0.0))))
    if _span(one.position) > reach:
        raise RecordingError(
            f"{one.label} spans {with_prefix(_span(one.position), one.unit, 3)}, but with gain = "
            f"{_gain(model)} its drive moves the stage by at most {with_prefix(reach, one.unit, 3)}, to and "
            "fro: a unit, of position or drive, or the gain is wrong"
        )


def refuse_loop(
    position: Array, force: Array, name: str, channels: tuple[str, str], moves: bool = False
) -> None:
    """Raise RecordingError if a friction loop has the wrong sign: the force does negative work, although
    friction dissipates work.

    Args:
        position: positions, m (rad), [n].
        force: force of a contact, or the force that drives a body, N (N m), [n].
        name: name of the recording.
        channels: names of the channels of position and force.
        moves: True: the force also accelerates a body, whose kinetic energy changes.

    Raises:
        RecordingError: position or force is noise, both are swapped, or the work is negative. Motions that
            cross their median position fewer than three times are tested for noise only.
    """
    for values, what in zip((position, force), channels, strict=True):
        refuse_noise(values, what, name)
    above = position > np.median(position)
    crossed = np.flatnonzero(above[1:] != above[:-1])
    if crossed.size < 3:
        return
    x, f = (values[crossed[0] : crossed[-1] + 2] for values in (position, force))
    f = f - f.mean()  # a constant force does no work over a closed loop, but would over its open ends
    work = float(np.trapezoid(f, x))
    by_force = noise_level(force) * float(np.linalg.norm(np.diff(x)))
    by_position = noise_level(position) * float(np.linalg.norm(np.diff(f)))
    half = 0.5 * _span(f)
    least = SURE * (by_force + by_position) + LOST * half * float(np.sum(np.abs(np.diff(x))))
    if work >= -least - (half * _span(x) if moves else 0.0):
        return
    if np.ptp(force) < np.ptp(position):  # a stiffness below 1 N/m: the columns are swapped
        raise RecordingError(
            f"{channels[1]} of {name} does negative work over its loops, and spans less newtons than "
            f"{channels[0]} spans metres: the two columns are swapped. Say which column is which (`columns`)"
        )
    raise RecordingError(
        f"{channels[1]} of {name} does negative work over its loops: the force acts the other way, or the "
        f'position does. Flip the sign of one: units: {{{channels[1]}: "-1 N"}}'
    )


def refuse_loading(grown: float, loaded: float, label: str) -> None:
    """Raise RecordingError if the recorded force of a pulled slider has the wrong size for its spring.

    Args:
        grown: mean growth of the force over weight in a stick-slip event.
        loaded: growth of the spring force over weight in an equal time if the slider does not move.
        label: name of the channel and the recording in the error.
    """
    if 1.0 / FACTOR < grown / loaded < FACTOR:
        return
    raise RecordingError(
        f"{label} grows by {grown:.3g} in an event, in which the spring adds {loaded:.3g} to the force over "
        "the weight: the unit of the force, the mass, the stiffness or the speed is wrong"
    )


def said_far(starts: Mapping[str, float], values: Mapping[str, float]) -> tuple[str, ...]:
    """Return a tuple with one sentence on forces and stiffnesses whose fitted `values` differ from their
    initial guesses `starts` by more than a factor of 900 (a unit may be wrong); otherwise an empty tuple."""
    far = [
        f"{name} is {abs(values[name] / start):.3g} times its start"
        for name, start in starts.items()
        if start and not 1.0 / FACTOR**2 <= abs(values[name] / start) <= FACTOR**2
    ]
    return (f"{', '.join(far)}: are the units of force and position right?",) if far else ()


def _span(values: Array) -> float:
    """Return the range of values, in their unit, without the largest and the smallest hundredth of the
    samples, which may be spikes."""
    low, high = np.percentile(values, [1.0, 99.0])
    return float(high - low)


def _slowest(model: Any) -> float:
    """Return the lower one of two natural frequencies of an actuator, rad/s: that of the stage with the
    end-effector, and that of the end-effector on its contact."""
    carried = model.end_effector_mass / model.stage_mass if model.stage_reaction else 0.0
    stage = model.natural_frequency / math.sqrt(1.0 + carried)
    law = model.friction
    stiffness = getattr(law, "sigma_0", None) or sum(getattr(law, "stiffness", (math.inf,)))
    return min(stage, math.sqrt(stiffness / model.end_effector_mass))


def _gain(model: Any) -> str:
    return with_prefix(model.gain, f"{unit_for(model, 'm')}/V", 4)
