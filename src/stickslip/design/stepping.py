"""Limits of stepping: the least voltage, the force that stops it, and the highest frequency.

Each is looked for on points that span the whole range, all at once, and then between two of them on ever
closer points. The step need not be monotone, so each says which crossing it is, and warns where there are
others.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..friction import breakaway, elements, rate
from ..friction import element as element_of
from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..quantities.progress import Progress, unheard
from ..quantities.units import QuantityError, optional_si, to_si, unit_for, with_prefix
from ..simulation.errors import SimulationError, SimulationWarning
from ..simulation.strain import strained
from ..waveform.periodic import Sawtooth
from ..waveform.signal import Waveform
from .maps import step_map

Array = NDArray[np.float64]

# Points of the first scan of a range, points between two of them in each round, and the largest number of
# rounds.
SCANNED, AGAIN, ROUNDS = 65, 15, 12
# What counts as a step, m: the least that stick-slip actuators are sold with, and a hundred
# times the tolerance of the solver. A presliding law creeps under any periodic drive that is not symmetric.
LEAST_STEP = 10e-9
TOLERANCE = 1e-10
_SEEN = 2.0 * TOLERANCE  # less may be the solver's

_Steps = Callable[[Array], xr.Dataset]


def minimum_voltage(
    model: Actuator,
    waveform: Waveform | None = None,
    *,
    frequency: float | str | None = None,
    step: float | str = LEAST_STEP,
    load: float | str = 0.0,
    direction: Literal[1, -1] = 1,
    max_voltage: float | str | None = None,
    output: OutputStage | None = None,
    tolerance: float | str = 1e-3,
    threads: int | None = None,
    progress: Progress = unheard,
) -> float:
    """The least voltage, from the least to the greatest value of the drive, at which it steps by `step`.

    With more voltage the step may become less again (at high frequencies it does): this is the first voltage
    at which it is reached, and a `SimulationWarning` says from where on it is not. What is reached only
    between two of 64 evenly spaced voltages is not seen.

    Args:
        model: the actuator.
        waveform, output: as for `step_map`.
        frequency: Hz; may be left out with a waveform.
        step: m, in the direction of the walk, > 0; 10 nm by default, the least step that stick-slip
            actuators are sold with. Smaller ones are mostly creep of the contact.
        load: N, positive towards +x, as for `step_map`.
        direction: 1, or -1 for the mirrored drive, which has to step towards -x.
        max_voltage: V; by default what is left of the model's range above the rest of the drive.
        tolerance: V: a voltage that is less by this does not reach the step.

    Raises:
        SimulationError: no voltage in the range reaches the step; says how far it comes.
        QuantityError: the range has no end, a number out of range; see also `step_map`.
    """
    frequency = optional_si(frequency, "Hz", "frequency")
    unit = unit_for(model, "m")
    step = _positive(step, unit, "step")
    load = to_si(load, unit_for(model, "N"), "load")
    volts, most = _positive(tolerance, "V", "tolerance"), optional_si(max_voltage, "V", "max_voltage")
    most = _highest_voltage(model, waveform, None if most is None else _positive(most, "V", "max_voltage"))
    if direction not in (1, -1):
        raise QuantityError(f"direction = {direction!r}: it is 1 (as the drive is) or -1 (mirrored)")
    fine = min(TOLERANCE, 0.01 * step)

    def steps(voltage: Array) -> xr.Dataset:
        return step_map(
            model,
            waveform,
            voltage=voltage,
            frequency=frequency,
            load=load,
            direction=direction,
            output=output,
            tolerance=fine,
            threads=threads,
        )

    def reached(voltage: Array) -> Array:
        return direction * steps(voltage)["net_step"].values - step

    at = np.linspace(0.0, most, SCANNED)
    found = reached(at)
    progress("scanning voltages", 0.5)
    ok = found >= 0.0
    if not np.any(ok):
        _refuse_none(
            found + step, at, f"no voltage up to {most:g} V steps by {with_prefix(step, unit)}", unit
        )
    first = int(np.argmax(ok))
    _warn_of_others(found, at, first, "V", "the step is reached at {}, and not any more at {}")
    low, high = at[max(first - 1, 0)], at[first]
    for _ in range(ROUNDS):
        if high - low <= volts:
            break
        inner = np.linspace(low, high, AGAIN + 2)
        hit = int(np.argmax(np.append(reached(inner[1:-1]) >= 0.0, True)))
        low, high = inner[hit], inner[hit + 1]
    progress("scanning voltages", 1.0)
    return float(high)


def blocking_force(
    model: Actuator,
    waveform: Waveform,
    *,
    max_load: float | str | None = None,
    output: OutputStage | None = None,
    tolerance: float | str = 1e-5,
    threads: int | None = None,
    progress: Progress = unheard,
) -> float:
    """The force against the walk at which the steady speed becomes zero, N, whichever way it walks.

    It is the first one from zero on at which the speed changes its sign; a `SimulationWarning` says
    where it does again.

    Args:
        model, waveform, output: as for `step_map`.
        max_load: N, how far to look; by default what the contact holds at rest at most, and the weight.
        tolerance: N: with a load that is less by this, it still walks.

    Raises:
        SimulationError: it does not walk without a load, up to no load does it stop, or there is no steady
            motion before it does.
        QuantityError: see `step_map`.
    """
    unit, length = unit_for(model, "N"), unit_for(model, "m")
    newton, most = _positive(tolerance, unit, "tolerance"), optional_si(max_load, unit, "max_load")
    most = _held(model) if most is None else _positive(most, unit, "max_load")
    common: dict[str, Any] = {"output": output, "tolerance": TOLERANCE, "threads": threads}
    free = float(step_map(model, waveform, load=0.0, **common)["net_step"])
    if not abs(free) > TOLERANCE:
        raise SimulationError(f"without a load it does not walk: its step is {with_prefix(free, length)}")
    way = math.copysign(1.0, free)

    def steps(load: Array) -> xr.Dataset:
        return step_map(model, waveform, load=-way * load, **common)

    at = np.linspace(0.0, most, SCANNED)
    scan = steps(at)
    found = way * scan["net_step"].values
    progress("scanning loads", 0.5)
    stopped = found <= 0.0
    first = int(np.argmax(stopped)) if np.any(stopped) else at.size
    lost = np.flatnonzero(~np.isfinite(found[:first]))
    if lost.size:
        why = str(scan["reason"].values[lost[0]])
        raise SimulationError(f"no steady walk against {at[lost[0]]:g} {unit}: {why}")
    if first == at.size:
        raise SimulationError(
            f"it still steps by {with_prefix(float(found[-1]), length)} against {most:g} {unit}: look "
            "farther, with max_load"
        )
    # A load that the contact cannot hold drags it along for ever: no walk, and nothing to warn of.
    _warn_of_others(np.nan_to_num(-found), at, first, unit, "it stops at {}, and walks on again at {}")
    low, high = at[first - 1], at[first]
    for _ in range(ROUNDS):
        if high - low <= newton:
            break
        inner = np.linspace(low, high, AGAIN + 2)
        values = np.append(way * steps(inner[1:-1])["net_step"].values, -1.0)
        hit = int(np.argmax(~(values > 0.0)))
        low, high = inner[hit], inner[hit + 1]
    progress("scanning loads", 1.0)
    return float(high)


def stepping_frequency_limit(
    model: Actuator,
    waveform: Waveform,
    share: float = 0.5,
    *,
    min_frequency: float | str = 1.0,
    max_frequency: float | str | None = None,
    output: OutputStage | None = None,
    tolerance: float | str = 0.1,
    threads: int | None = None,
    progress: Progress = unheard,
) -> float:
    """The highest frequency with a net step of at least a share of the greatest one, Hz.

    The greatest is that of 65 frequencies, evenly spaced on a logarithmic axis. It is not taken at the lowest
    of them, for a drive whose fast stroke takes a part of the period does not slip at all when it is slow. A
    share of zero asks for a step in the direction of the greatest of twice the solver's tolerance, the least
    that counts. Nothing is said of gaps below: a map shows them.

    Args:
        model, waveform, output: as for `step_map`.
        share: of the greatest step, 0 <= share < 1.
        min_frequency, max_frequency: Hz, where to look; up to ten times the natural frequency of the stage by
            default.
        tolerance: Hz: a frequency that is higher by this does not reach the share.

    Raises:
        SimulationError: there is no step at all, or the highest frequency still reaches the share.
        QuantityError: see `step_map`.
    """
    least, hertz = _positive(min_frequency, "Hz", "min_frequency"), _positive(tolerance, "Hz", "tolerance")
    most = optional_si(max_frequency, "Hz", "max_frequency")
    if most is None:
        most = 10.0 * model.natural_frequency / (2.0 * math.pi)
    if not least < most < math.inf:
        raise QuantityError(
            f"max_frequency = {most:g} Hz is out of range: it must be finite and above {least:g} Hz"
        )
    share = to_si(share, "", "share")
    if not 0.0 <= share < 1.0:
        raise QuantityError(f"share = {share!r} is out of range: it must be >= 0 and < 1")

    def steps(frequency: Array) -> Array:
        found = step_map(
            model, waveform, frequency=frequency, output=output, tolerance=TOLERANCE, threads=threads
        )
        return found["net_step"].values

    at = np.geomspace(least, most, SCANNED)
    found = steps(at)
    progress("scanning frequencies", 0.5)
    greatest = float(found[np.nanargmax(np.abs(found))]) if np.any(np.isfinite(found)) else 0.0
    if not abs(greatest) >= _SEEN:
        said = f"at most {with_prefix(abs(greatest), unit_for(model, 'm'))}, within the solver's tolerance"
        raise SimulationError(f"there is no step from {least:g} Hz to {most:g} Hz: {said}")
    way, wanted = math.copysign(1.0, greatest), max(share * abs(greatest), _SEEN)
    last = int(np.flatnonzero(way * found >= wanted)[-1])
    if last == at.size - 1:
        raise SimulationError(f"at {most:g} Hz it still reaches the share: look farther, with max_frequency")
    low, high = at[last], at[last + 1]
    for _ in range(ROUNDS):
        if high - low <= hertz:
            break
        inner = np.linspace(low, high, AGAIN + 2)
        hit = int(np.flatnonzero(np.append(True, way * steps(inner[1:-1]) >= wanted))[-1])
        low, high = inner[hit], inner[hit + 1]
    progress("scanning frequencies", 1.0)
    return float(low)


def load_speed_curve(
    model: Actuator,
    waveform: Waveform,
    loads: ArrayLike,
    **options: Any,
) -> xr.Dataset:
    """`step_map` over the load, with the `mechanical_power` (W) done against it: minus speed times load.

    Args:
        model, waveform: as for `step_map`.
        loads: N, positive towards +x.
        options: of `step_map`: fit, stack, output, quantities, tolerance, ...
    """
    made = step_map(model, waveform, load=loads, **options)
    power = -made["speed"] * made["load"]
    return made.assign(mechanical_power=power.assign_attrs(units="W", long_name="mechanical power"))


def _held(model: Actuator) -> float:
    """Load that no contact at rest holds, N."""
    law = model.friction
    if not elements(law):
        return float(breakaway(law)) + abs(model.axial_force)
    ends = strained(law, math.inf)
    return sum(rate(element_of(law, e), 0.0, z)[0] for e, z in enumerate(ends)) + abs(model.axial_force)


def _positive(value: float | str, unit: str, field: str) -> float:
    number = to_si(value, unit, field)
    if not 0.0 < number < math.inf:
        raise QuantityError(f"{field} = {number:g} {unit} is out of range: it must be > 0 {unit} and finite")
    return number


def _highest_voltage(model: Actuator, waveform: Waveform | None, asked: float | None) -> float:
    """Return the highest voltage: `asked`, within the model's range above the rest of the drive."""
    rest = waveform.range()[0] if waveform is not None else Sawtooth(1.0, 1.0).offset
    most = model.max_voltage - max(rest, model.min_voltage)
    if asked is not None:
        if asked > most:
            raise QuantityError(
                f"max_voltage = {asked:g} V is out of range: {model.name or 'the actuator'} takes "
                f"{model.max_voltage:g} V at most, {most:g} V above the rest of the drive"
            )
        return asked
    if not 0.0 < most < math.inf:
        raise QuantityError(
            f"max_voltage must be given in V: the model's own, {model.max_voltage:g} V, leaves no range "
            f"above {rest:g} V"
        )
    return most


def _refuse_none(found: Array, at: Array, words: str, unit: str) -> None:
    if not np.any(np.isfinite(found)):
        raise SimulationError(f"{words}: there is no steady walk at any of {at.size} points")
    best = int(np.nanargmax(found))
    raise SimulationError(f"{words}: at most by {with_prefix(float(found[best]), unit)}, at {at[best]:g} V")


def _warn_of_others(found: Array, at: Array, first: int, unit: str, words: str) -> None:
    """Warn where values that were not negative become so again, or are unknown."""
    later = np.flatnonzero(found[first:] < 0.0)
    unknown = np.flatnonzero(~np.isfinite(found))
    if later.size:
        text = words.format(f"{at[first]:.4g} {unit}", f"{at[first + later[0]]:.4g} {unit}")
        warnings.warn(text, SimulationWarning, stacklevel=3)
    elif unknown.size:
        text = f"there is no steady walk at {at[unknown[0]]:.4g} {unit}: what was found is among the others"
        warnings.warn(text, SimulationWarning, stacklevel=3)
