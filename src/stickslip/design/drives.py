"""Drives of the points of a map: stroke, frequency, mirror image.

The mirror image of a drive reverses its voltage within its range: u becomes u_low + u_high - u. An actuator
without load, weight or bias walks back under the mirror image exactly as far as it walks forward under the
drive.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.actuator import Actuator
from ..quantities.units import QuantityError
from ..simulation.varied import record_names
from ..waveform.knots import PeriodicKnots
from ..waveform.periodic import Sawtooth, Sine
from ..waveform.signal import Waveform

Array = NDArray[np.float64]


def default_drive(model: Actuator, voltage: bool, frequency: bool) -> Sawtooth:
    """Return the default drive of a map: a sawtooth of 1 V and 1 Hz. The map replaces its voltage and
    frequency.

    The sawtooth rests at 0 V, or at the end of the actuator's voltage range that is closest to 0 V.

    Args:
        model: the actuator.
        voltage: True if the user has given voltages for the map.
        frequency: True if the user has given frequencies.

    Raises:
        QuantityError: one or both are False, so that the drive is not defined.
    """
    if not (voltage and frequency):
        lacking = "frequency [Hz]" if voltage else "voltage [V]"
        raise QuantityError(f"without a waveform, {lacking} must be given")
    rest = min(max(0.0, model.min_voltage), model.max_voltage)
    return Sawtooth(1.0, 1.0, offset=rest)


def drive_columns(
    waveform: Waveform,
    own: Mapping[str, Array],
    voltage: Array | None,
    frequency: Array | None,
    direction: Array | None,
) -> dict[str, Array]:
    """Return the fields of the waveform that differ between members (points of the map), by name, arrays
    [members], SI.

    Args:
        waveform: drive of the map.
        own: fields of the waveform that the map varies directly, by name, arrays [members].
        voltage: difference between the greatest and the least value of the drive, V, [members]; the rest
            value (the middle of a sine, the least value of knots) is unchanged. None: as in the waveform.
        frequency: Hz, [members]; None: as in the waveform.
        direction: 1, or -1 for the mirror image, [members]; None: 1.

    Raises:
        QuantityError: the waveform has no amplitude or frequency, or `own` varies the same quantity.
    """
    if voltage is None and frequency is None and direction is None:
        return dict(own)
    names, kind = record_names(waveform), type(waveform).__name__
    if isinstance(waveform, PeriodicKnots):
        return _of_knots(waveform, own, voltage, frequency, direction)
    made, of = dict(own), dict.fromkeys(["amplitude"] if voltage is not None or direction is not None else [])
    for name in [*of, *(["frequency"] if frequency is not None else [])]:
        if name not in names:
            raise QuantityError(
                f"a {kind} has no {name}: voltage, frequency and direction vary of waveforms with amplitude "
                "and frequency, and of PeriodicKnots"
            )
    if voltage is not None and "amplitude" in own:
        raise QuantityError("voltage [V] and the parameter 'amplitude' [V] are the same: give one of them")
    if frequency is not None:
        made["frequency"] = frequency
    fields: Any = waveform
    middle = isinstance(waveform, Sine)
    stroke = own.get("amplitude", np.asarray(fields.amplitude if of else 0.0))
    if voltage is not None:
        stroke = np.copysign(voltage * (0.5 if middle else 1.0), fields.amplitude)
        made["amplitude"] = stroke
    if direction is not None:
        made["amplitude"] = stroke * direction
        if not middle:
            rest = own.get("offset", np.asarray(fields.offset))
            made["offset"] = rest + np.where(direction < 0.0, stroke, 0.0)
    return made


def _of_knots(
    waveform: PeriodicKnots,
    own: Mapping[str, Array],
    voltage: Array | None,
    frequency: Array | None,
    direction: Array | None,
) -> dict[str, Array]:
    """Return the columns of `drive_columns` for `PeriodicKnots`: "period", "time_1", ..., "value_1", ...

    Times are in proportion to the period. Voltages are scaled about the lowest knot, and mirrored within
    their range for the direction -1.

    Raises:
        QuantityError: `own` varies a field of the knots, or a constant voltage has no stroke to scale.
    """
    if own:
        raise QuantityError(
            f"{next(iter(own))!r} is a field of the knots: where it varies, voltage, frequency and direction "
            "cannot"
        )
    made, (low, high) = dict[str, Array](), waveform.range()
    if frequency is not None:
        made["period"] = 1.0 / frequency
        for k, t in enumerate(waveform.times):
            made[f"time_{k + 1}"] = t / waveform.period * made["period"]
    if voltage is None and direction is None:
        return made
    if voltage is not None and not high > low:
        raise QuantityError("knots of one value (in V) have no stroke that could vary")
    swing = high - low if voltage is None else voltage
    for k, u in enumerate(waveform.values):
        share = np.asarray((u - low) / (high - low) if high > low else 0.0)
        made[f"value_{k + 1}"] = low + swing * (
            share if direction is None else np.where(direction < 0.0, 1.0 - share, share)
        )
    return made
