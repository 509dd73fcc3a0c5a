"""Limits of stepping: the least voltage, the force that stops the actuator, and the highest frequency; and
the speed over the load.

Each limit is searched on points over the whole range at once, and then between two of them on ever closer
points. The step need not be monotonic, so each function says which crossing it returns; `minimum_voltage` and
`blocking_force` warn if there are others.
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

# A limit is searched by a scan of the whole range and then between two neighbouring points. SCANNED: number
# of points of the scan; AGAIN: number of points between the two in each round; ROUNDS: largest number of
# rounds.
SCANNED, AGAIN, ROUNDS = 65, 15, 12
# Smallest net step that counts as a step by default, m: the smallest one with which stick-slip actuators are
# sold, and a hundred times the tolerance of the solver. Smaller motions may be creep: a law with presliding
# creeps under any asymmetric periodic drive.
LEAST_STEP = 10e-9
# Tolerance of a computed net step, m, or rad for a rotary actuator.
TOLERANCE = 1e-10
# Smallest net step, in the same unit, that is certainly not an error of the solver.
_SEEN = 2.0 * TOLERANCE

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
    """Return the smallest peak-to-peak voltage of the drive, V, at which the net step is at least `step`.

    At higher voltage the step may decrease again (at high frequencies it does): then a `SimulationWarning`
    names the voltage from which the step is not reached any more. Otherwise one names a scanned voltage
    without a steady walk, if there is any. A step that is reached only between two of 65 evenly spaced
    voltages is not found.

    Args:
        model: the actuator.
        waveform, output: as for `step_map`.
        frequency: frequency of the drive, Hz; by default that of the waveform.
        step: required net step, m (rad for a rotary actuator), in the direction of the walk, > 0; by default
            1e-8, the smallest step with which stick-slip actuators are sold. Smaller ones are mostly creep of
            the contact.
        load: external force, N, positive towards +x, as for `step_map`.
        direction: 1, or -1 for the mirrored drive, which has to step towards -x.
        max_voltage: end of the search, V, peak to peak; by default the model's range above the rest voltage
            of the drive.
        tolerance: largest error of the result, V: a voltage lower by this amount does not reach the step.
        threads: as for `step_map`.
        progress: called after the scan and at the end, with activity and finished fraction.

    Raises:
        SimulationError: no voltage in the range reaches the step; the message names the largest step.
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
    """Return the blocking force, N, or N m for a rotary actuator: the load against the walk at which the
    steady speed becomes zero.

    The result is the smallest load at which the speed changes its sign; a `SimulationWarning` names a larger
    load at which the actuator walks again.

    Args:
        model, waveform, output, threads: as for `step_map`.
        progress: as for `minimum_voltage`.
        max_load: end of the search, N; by default the largest force that the contact holds at rest, plus the
            magnitude of weight and external force together.
        tolerance: largest error of the result, N: with a load lower by this amount the actuator still walks.

    Raises:
        SimulationError: the actuator does not walk without a load, does not stop up to `max_load`, or has no
            steady motion at a load before it stops.
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
    # At loads above the crossing a NaN step means that the contact cannot hold the load: the end-effector is
    # dragged away without end. This is no further crossing and needs no warning, so NaN is replaced by 0.
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
    """Return the highest frequency, Hz, at which the net step is at least a share of the greatest one.

    The greatest step is the greatest one at 65 frequencies, evenly spaced on a logarithmic axis. It need not
    be at the lowest frequency, because a drive whose fast stroke takes a part of the period does not slip if
    it is slow. A share of zero means a step in the direction of the greatest step of at least twice the
    solver's tolerance. Gaps at lower frequencies are not reported; a map shows them.

    Args:
        model, waveform, output, threads: as for `step_map`.
        progress: as for `minimum_voltage`.
        share: share of the greatest step, 0 <= share < 1.
        min_frequency, max_frequency: range of the search, Hz; by default up to ten times the natural
            frequency of the stage.
        tolerance: largest error of the result, Hz: a frequency higher by this amount does not reach the
            share.

    Raises:
        SimulationError: there is no step at all, or `max_frequency` still reaches the share.
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
    """Return a `step_map` over the load, with a further variable `mechanical_power`, W: the power that the
    actuator delivers against the load (minus speed times load).

    Args:
        model, waveform: as for `step_map`.
        loads: external forces on the end-effector, N, or N m for a rotary actuator, positive towards +x.
        options: further arguments of `step_map`: fit, stack, output, quantities, tolerance, ...

    Raises:
        QuantityError: see `step_map`.
    """
    made = step_map(model, waveform, load=loads, **options)
    power = -made["speed"] * made["load"]
    return made.assign(mechanical_power=power.assign_attrs(units="W", long_name="mechanical power"))


def _held(model: Actuator) -> float:
    """Return an upper limit of the load that the contact can hold at rest, N, or N m for a rotary actuator.

    The limit is the breakaway force plus the magnitude of weight and external force along the axis. The
    search for the blocking force ends there.
    """
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
    """Return the largest peak-to-peak voltage of a search, V: `asked`, or for None the model's whole range
    above the lowest voltage of the drive.

    Raises:
        QuantityError: `asked` exceeds that range, or it is not given and the range is empty or infinite.
    """
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
    """Warn if there may be other crossings: `found` becomes negative again after index `first`, or is NaN at
    some point of the scan.

    Args:
        found: values at the points of the scan; the search is for the first one that is not negative.
        at: voltages or loads of the points, in `unit`.
        first: index of the first point with a value that is not negative.
        unit: unit of `at`.
        words: sentence of the warning with two places "{}": for the voltage or load of the first crossing,
            and of the next point with a negative value.
    """
    later = np.flatnonzero(found[first:] < 0.0)
    unknown = np.flatnonzero(~np.isfinite(found))
    if later.size:
        text = words.format(f"{at[first]:.4g} {unit}", f"{at[first + later[0]]:.4g} {unit}")
        warnings.warn(text, SimulationWarning, stacklevel=3)
    elif unknown.size:
        text = f"there is no steady walk at {at[unknown[0]]:.4g} {unit}: what was found is among the others"
        warnings.warn(text, SimulationWarning, stacklevel=3)
