r"""Current, energy and heat of a piezo stack under many periodic drives.

A drive has the same curve over its period at every frequency f. It is approximated by straight lines, with
the voltage :math:`\Delta u_k` over the share :math:`\Delta\varphi_k` of the period. Then

.. math:: i_{max} = C f \max_k \frac{|\Delta u_k|}{\Delta\varphi_k}, \qquad
          i_{rms} = C f \sqrt{\sum_k \frac{\Delta u_k^2}{\Delta\varphi_k}}, \qquad
          E = \frac C2 \sum_{k:\,\Delta(u^2) > 0} \Delta(u^2)_k + Q, \qquad P = f Q

where i is the current, C the capacitance, P the heat in the stack, and Q the hysteresis loss of the closed
cycles of a period (see `physics.electronics.Stack`). E is the energy that the amplifier delivers in a period.
Most of it returns and becomes heat in the amplifier, unless that recovers it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..physics.actuator import Actuator
from ..physics.electronics.cycles import half_cycles
from ..physics.electronics.lines import jumps, lines_of
from ..physics.electronics.output import OutputStage
from ..physics.electronics.stack import Stack
from ..quantities.units import QuantityError, with_prefix
from ..waveform.signal import Waveform
from .drives import endless
from .varied import put_in, record_names

Array = NDArray[np.float64]

UNITS = {
    "peak_current": ("A", "greatest current"),
    "rms_current": ("A", "rms current"),
    "energy_per_step": ("J", "energy that the amplifier delivers per period"),
    "heat": ("W", "mean loss in the stack"),
    "temperature_rise": ("K", "steady temperature of the stack above its surroundings"),
}
# Largest deviation between a drive and the straight lines that approximate it, as a fraction of its
# peak-to-peak voltage.
PARTS = 1e-4


def refuse_stack(model: Any, stack: Any) -> None:
    """Raise QuantityError if `stack` is not a `Stack`, or the model cannot drive one.

    A pulled slider has no piezo, and the current of a `MaxwellCapacitor` follows from its own charge.
    """
    if not isinstance(stack, Stack):
        raise QuantityError(
            f"stack = {stack!r} must be a Stack: ss.physics.electronics.load_stack takes one by its name"
        )
    if not isinstance(model, Actuator):
        raise QuantityError("stack: a PulledSlider has none")
    if model.two_port is not None:
        raise QuantityError(
            "stack: the piezo has a charge and current of its own (a MaxwellCapacitor), which are in the "
            "trajectories of simulate, and not those of a stack"
        )


def electrical_demand(
    waveform: Waveform,
    columns: Mapping[str, Array],
    stack: Stack,
    count: int,
    output: OutputStage | None = None,
) -> dict[str, Array]:
    """Return peak_current and rms_current [A], energy_per_step [J], heat [W] and temperature_rise [K] by
    name, an array [members] each; NaN for members with fields that the waveform or the output stage refuses.

    Args:
        waveform: the common drive, V.
        columns: varied fields by name, [members]; only fields of the waveform are used.
        stack: the piezo stack.
        count: number of members.
        output: converter and amplifier that the drives pass; by default, the stack gets the drive itself.

    Raises:
        QuantityError: a drive has no period, or jumps, which takes an infinite current; or "drive_scale" is
            varied.
    """
    if getattr(waveform, "period", None) is None:
        raise QuantityError(f"stack: {type(waveform).__name__} has no period: its current is not known")
    if "drive_scale" in columns:
        raise QuantityError("stack: under a drive_scale the current is not known: vary the amplitude")
    names = record_names(waveform)
    columns = {name: column for name, column in columns.items() if name in names}
    # Members whose curves over the period are equal share one computation. Without an output stage, frequency
    # and period do not change that curve; the times of knots then scale with a varied period.
    stretched = "period" in columns
    shapes = [
        n
        for n in columns
        if output is not None
        or (n not in ("frequency", "period") and not (stretched and n.startswith("time_")))
    ]
    periods = 1.0 / columns["frequency"] if "frequency" in columns else columns.get("period")
    periods = None if output is not None else periods
    made = np.full((len(UNITS), count), np.nan)
    table = np.column_stack([columns[n] for n in shapes]) if shapes else np.zeros((count, 1))
    _, first, which = np.unique(table, axis=0, return_index=True, return_inverse=True)
    which = which.reshape(-1)
    for kind, member in enumerate(first.tolist()):
        one = _with_fields(waveform, {n: float(c[member]) for n, c in columns.items()}, output)
        if one is None:
            continue
        rows = np.flatnonzero(which == kind)
        per = 1.0 / (np.full(rows.size, one.period) if periods is None else periods[rows])
        peak, rms, energy, loss = _of_one_period(one, stack)
        heat = per * loss
        made[:, rows] = (
            per * peak,
            per * rms,
            np.full(rows.size, energy),
            heat,
            stack.thermal_resistance * heat,
        )
    return dict(zip(UNITS, made, strict=True))


def _with_fields(waveform: Any, values: Mapping[str, float], output: OutputStage | None) -> Any:
    """Return the waveform with changed fields (`values` by name, see `varied.record_names`), after the output
    stage unless that is None. Return None if the waveform or the output stage refuses the values."""
    try:
        one = type(waveform)(**put_in(waveform, values)) if values else waveform
        return one if output is None else output.behind(endless(one))
    except QuantityError:
        return None


def lines_off(waveform: Any) -> float:
    """Return the largest deviation, V, between a drive and the straight lines that approximate it."""
    return max(PARTS * float(np.ptp(waveform.range())), 1e-9)


def _of_one_period(waveform: Any, stack: Stack) -> tuple[float, float, float, float]:
    """Return a tuple for one period of a drive: peak current times period [A s], rms current times period [A
    s], energy that the amplifier delivers [J], and hysteresis loss in the stack [J].

    Raises:
        QuantityError: the drive jumps.
    """
    period, tolerance = float(waveform.period), lines_off(waveform)
    lines = lines_of(waveform.drive(period), period, tolerance)
    share, volts = lines.bounds / period, np.append(lines.values, lines.end)
    jumped = np.append(jumps(lines)[0][1:], lines.values[0] - lines.end)
    if np.abs(jumped).max() > 2.0 * tolerance:
        raise QuantityError(
            f"{type(waveform).__name__} jumps by {with_prefix(float(np.abs(jumped).max()), 'V')}, which "
            "takes an infinite current: give it a fall that takes time (rise_fraction < 1), or an amplifier "
            "(output)"
        )
    change, stored = np.diff(volts), 0.5 * np.diff(volts**2)
    top = int(np.argmax(volts[:-1]))
    turned = np.roll(volts[:-1], -top)
    loss = 0.5 * float(np.sum(stack.cycle_loss(half_cycles(np.append(turned, turned[0]))[0])))
    peak = stack.load * float(np.max(np.abs(change) / np.diff(share)))
    rms = stack.load * math.sqrt(float(np.sum(change**2 / np.diff(share))))
    return peak, rms, stack.load * float(np.sum(np.maximum(stored, 0.0))) + loss, loss


def labelled_demand(
    model: Actuator,
    waveform: Waveform,
    columns: Mapping[str, Array],
    stack: Stack | None,
    count: int,
    output: OutputStage | None = None,
) -> dict[str, Any]:
    """Return the results of `electrical_demand` by name as xarray variables over "member", with units; an
    empty mapping if `stack` is None. Raise QuantityError as `refuse_stack` and `electrical_demand`."""
    if stack is None:
        return {}
    refuse_stack(model, stack)
    found = electrical_demand(waveform, columns, stack, count, output)
    return {
        name: ("member", values, dict(zip(("units", "long_name"), UNITS[name], strict=True)))
        for name, values in found.items()
    }
