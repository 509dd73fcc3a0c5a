"""Calibration of the steps of any positioner: bursts of steps, measured by a sensor or from limit to limit.

A sensor is a function that returns the position in metres: from a camera, a gauge, or ``lambda:
controller.position(0)`` for a controller with a sensor. Without a sensor, two limits at a known distance are
enough, with a function that returns at which limit the axis is (from a switch, an image, the controller's
status). `step_law.fit_steps` computes the law from the measurements.
"""

from __future__ import annotations

import csv
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import xarray as xr

from ..gate.errors import GateError
from ..gate.text import decoded, read_file
from ..quantities.progress import Progress, unheard
from ..quantities.records import Quantity, record
from ..quantities.units import QuantityError, to_si
from ..rig.positioner import Positioner, need_armed, wait
from ..rig.protocols import RigError

_LIMIT = Quantity("m", "", "the distance between the limits", above=0)
_NOISE = Quantity("m", "", "the standard deviation of a measured way", minimum=0)
_COLUMNS = {"voltage": "V", "direction": "", "steps": "", "displacement": "m", "noise": "m"}
_HEAD = ", ".join(f"{name} [{unit}]" if unit else name for name, unit in _COLUMNS.items())
_MOST_BYTES = 10_000_000  # largest size of a file of bursts, bytes
_MOST_STEPS = 10_000_000  # largest number of steps from limit to limit


@record
class Bursts(NamedTuple):
    """Plan of bursts (groups of equal steps) for a calibration.

    For each of the `voltages` [V], `bursts` bursts of `steps` steps each, at a `frequency` [Hz], are made
    forward and then backward. All voltages are repeated `repeats` times. `settle` is the rest before each
    reading, s. The displacement of the first burst after a change of direction is too small, so each
    direction needs at least two bursts.
    """

    voltages: Annotated[tuple[float, ...], Quantity("V", "A", "amplitudes", above=0)]
    frequency: Annotated[float, Quantity("Hz", "f", "steps per second", above=0)] = 100.0
    steps: Annotated[float, Quantity("", "n", "steps of a burst", minimum=1, maximum=1e6)] = 50
    bursts: Annotated[float, Quantity("", "", "bursts in one direction", minimum=2, maximum=1000)] = 2
    repeats: Annotated[float, Quantity("", "", "repeats of all voltages", minimum=1, maximum=1000)] = 4
    settle: Annotated[float, Quantity("s", "t_s", "rest before a reading", minimum=0)] = 0.1

    def _check(self) -> None:
        if not self.voltages or len(set(self.voltages)) != len(self.voltages):
            raise QuantityError(f"Bursts.voltages [V] must be different ones, one at least: {self.voltages}")
        for name in ("steps", "bursts", "repeats"):
            if getattr(self, name) % 1:
                raise QuantityError(f"Bursts.{name} = {getattr(self, name):g} must be a whole number")

    @property
    def plan(self) -> Iterator[tuple[float, int, bool]]:
        """Yield a tuple for each burst: voltage [V], direction (1 or -1), and True if the direction changes
        before it (also before the first).

        Every other repeat takes the voltages in reverse order.
        """
        before = 0
        for repeat in range(int(self.repeats)):
            for volts in self.voltages[:: 1 if repeat % 2 == 0 else -1]:
                for direction in (1, -1):
                    for _ in range(int(self.bursts)):
                        yield volts, direction, direction != before
                        before = direction


def measure_steps(
    positioner: Positioner,
    axis: int,
    sensor: Callable[[], float],
    bursts: Bursts,
    *,
    noise: float | str,
    progress: Progress = unheard,
    keep: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Make bursts of steps and measure their displacements.

    Args:
        positioner: any `rig.Positioner`; it is stopped at the end and after an error.
        axis: axis of the positioner.
        sensor: function that returns the position in metres, increasing with steps up.
        bursts: the bursts to make.
        noise: standard deviation of a reading, m.
        progress: function that is called with the activity and the finished fraction.
        keep: CSV file, replaced, to which each burst is written when it is measured. After an error or an
            interruption, `read_bursts` reads the finished bursts from it.

    Returns:
        Dataset over "burst", for `fit_steps`: voltage (V), direction (1 or -1), steps, displacement (m),
        noise (m, standard deviation of the displacement), after_reversal (1 for the first burst in a
        direction); attributes frequency (Hz) and source, the name of the positioner.

    Raises:
        InterlockError: the positioner is not simulated, and the program not armed.
        RigError, QuantityError: from the positioner; or a reading is not a number.
        OSError: `keep` cannot be written.
    """
    sigma, rows = math.sqrt(2.0) * _NOISE.check(noise, "noise"), _Rows(keep)
    need_armed(positioner)
    for volts in bursts.voltages:
        positioner.ranges.check(axis, int(bursts.steps), volts, bursts.frequency)
    plan = list(bursts.plan)
    try:
        before = _reading(sensor)
        for number, (volts, direction, reversed_) in enumerate(plan):
            progress("stepping", number / len(plan))
            _step(positioner, axis, direction * int(bursts.steps), volts, bursts)
            now = _reading(sensor)
            rows.add(volts, direction, bursts.steps, now - before, sigma, reversed_)
            before = now
    finally:
        positioner.stop()
    return _dataset(rows.all, bursts.frequency, positioner.ranges.name)


def measure_travel(
    positioner: Positioner,
    axis: int,
    at_limit: Callable[[], int],
    travel: float | str,
    bursts: Bursts,
    *,
    error: float | str = 0.0,
    progress: Progress = unheard,
    keep: str | os.PathLike[str] | None = None,
) -> xr.Dataset:
    """Count the steps from limit to limit, for each voltage and direction, `repeats` times; return a dataset
    over "burst" for `fit_steps`, with the variables of `measure_steps`.

    First the axis steps to the lower limit, at the largest voltage. The positioner is stopped at the end and
    after an error.

    Args:
        positioner, axis, progress, keep: as for `measure_steps`.
        at_limit: function that returns 1 at the upper limit, -1 at the lower, 0 in between.
        travel: distance between the limits, m.
        bursts: plan; its `steps` are made between two checks of the limit. The limit lies within the last
            ones, of which half are counted. The plan's `bursts` is not used.
        error: standard deviation of the limits' positions, m.

    Raises:
        InterlockError: the positioner is not simulated, and the program not armed.
        RigError: a limit is not reached; or from the positioner.
        QuantityError: from the positioner; or the travel is out of range.
    """
    way, repeats = _LIMIT.check(travel, "travel"), _NOISE.check(error, "error")
    need_armed(positioner)
    rows = _Rows(keep)
    try:
        _to_limit(positioner, axis, at_limit, -1, max(bursts.voltages), bursts)
        total = int(bursts.repeats) * len(bursts.voltages)
        for repeat in range(int(bursts.repeats)):
            for number, volts in enumerate(bursts.voltages):
                progress("from limit to limit", (repeat * len(bursts.voltages) + number) / total)
                for direction in (1, -1):
                    count = _to_limit(positioner, axis, at_limit, direction, volts, bursts)
                    if count == 0:
                        raise RigError("the axis is at both limits at once: check the function at_limit")
                    unsure = bursts.steps / math.sqrt(12.0) * way / count
                    sigma = math.hypot(unsure, math.sqrt(2.0) * repeats)
                    rows.add(volts, direction, count - 0.5 * bursts.steps, direction * way, sigma, True)
    finally:
        positioner.stop()
    return _dataset(rows.all, bursts.frequency, positioner.ranges.name)


class _Rows:
    """Measured bursts: rows with the values of `_COLUMNS` (SI) and True after a change of direction.

    If a file is given, each row is also a line of it, written at once.
    """

    def __init__(self, file: str | os.PathLike[str] | None) -> None:
        self.all: list[tuple[float, ...]] = []
        self._file = None if file is None else Path(file)

    def add(self, *row: float) -> None:
        """Add a burst."""
        if self._file is not None:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open("a" if self.all else "w", encoding="utf-8") as file:
                file.write(("" if self.all else f"{_HEAD}\n") + f"{_line(row)}\n")
        self.all.append(row)


def _to_limit(
    positioner: Positioner,
    axis: int,
    at_limit: Callable[[], int],
    direction: int,
    volts: float,
    bursts: Bursts,
) -> int:
    """Step until the limit of a direction (1: upper, -1: lower) is reached; return the number of steps.

    Args:
        positioner, axis, at_limit, direction: as for `measure_travel`.
        volts: amplitude, V.
        bursts: plan, of which frequency, rest, and number of steps between two checks are used.

    Raises:
        RigError: the limit is not reached within `_MOST_STEPS`.
    """
    count = 0
    while at_limit() != direction:
        _step(positioner, axis, direction * int(bursts.steps), volts, bursts)
        count += int(bursts.steps)
        if count > _MOST_STEPS:
            which = "upper" if direction > 0 else "lower"
            raise RigError(
                f"the {which} limit is not reached after {count} steps of {volts:g} V: is it seen?"
            )
    return count


def _step(positioner: Positioner, axis: int, count: int, volts: float, bursts: Bursts) -> None:
    positioner.step(axis, count, volts, bursts.frequency)
    wait(positioner, axis, 10.0 + 2.0 * abs(count) / bursts.frequency)
    time.sleep(bursts.settle)


def _reading(sensor: Callable[[], float]) -> float:
    value = to_si(sensor(), "m", "the sensor's position")
    if not math.isfinite(value):
        raise QuantityError(f"the sensor's position is {value}: it must be a number in m")
    return value


def _dataset(rows: list[Any], frequency: float, source: str) -> xr.Dataset:
    names = {**_COLUMNS, "after_reversal": ""}
    columns = np.array(rows, dtype=float).reshape(len(rows), len(names)).T
    values = dict(zip(names, columns, strict=True))
    made = xr.Dataset({name: ("burst", values[name], {"units": unit}) for name, unit in names.items()})
    made.attrs |= {"frequency": frequency, "source": source}
    return made


def read_bursts(path: str | os.PathLike[str], frequency: float | str) -> xr.Dataset:
    """Return bursts from a CSV file, in the order of its lines, as a dataset like that of `measure_steps`.

    A burst in another direction than the previous one, and the first burst, count as after a change of
    direction. Lines that start with # are ignored. The first other line names the columns, in any order,
    ``voltage [V], direction, steps, displacement [um], noise [nm]``, with any units of these kinds. The
    direction is 1 or -1, the displacement is positive towards +x, and the noise is the standard deviation of
    the displacement.

    Args:
        path: path of the file.
        frequency: frequency of the steps, Hz.

    Raises:
        QuantityError: the file is not as described; the message names file and line.
    """
    path, hertz = Path(path), to_si(frequency, "Hz", "frequency")
    try:
        lines = decoded(read_file(path, _MOST_BYTES), str(path)).splitlines()
    except (OSError, GateError) as error:
        raise QuantityError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    numbered = [(i, row) for i, row in enumerate(csv.reader(lines), 1) if row and not row[0].startswith("#")]
    if not numbered:
        raise QuantityError(f"{path}: the file is empty; it needs a line of names and one for each burst")
    names = [cell.partition("[")[0].strip() for cell in numbered[0][1]]
    if sorted(names) != sorted(_COLUMNS):
        raise QuantityError(
            f"{path}, line {numbered[0][0]}: the columns are {', '.join(names)}; write "
            "voltage [V], direction, steps, displacement [um], noise [nm]"
        )
    units = [cell.partition("[")[2].strip(" ]") for cell in numbered[0][1]]
    rows, before = [], 0.0
    for line, row in numbered[1:]:
        if len(row) != len(names):
            raise QuantityError(f"{path}, line {line}: {len(row)} cells, the first line has {len(names)}")
        try:
            said = {
                n: to_si(f"{c.strip()} {u}", _COLUMNS[n], n)
                for n, c, u in zip(names, row, units, strict=True)
            }
        except QuantityError as error:
            raise QuantityError(f"{path}, line {line}: {error}") from None
        if said["direction"] not in (1.0, -1.0) or said["steps"] < 1.0:
            raise QuantityError(f"{path}, line {line}: a direction is 1 or -1, and steps are 1 at least")
        rows.append((*(said[name] for name in _COLUMNS), said["direction"] != before))
        before = said["direction"]
    return _dataset(rows, hertz, path.name)


def write_bursts(bursts: xr.Dataset, path: str | os.PathLike[str]) -> None:
    """Write bursts, a dataset from `measure_steps`, as the CSV file that `read_bursts` reads, in SI units.
    The file does not contain their frequency, nor after_reversal."""
    rows = np.column_stack([bursts[name].values for name in _COLUMNS]).tolist()
    lines = [_HEAD, *map(_line, rows)]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _line(row: Sequence[float]) -> str:
    """Return the line of a burst in a CSV file; only the values of `_COLUMNS`, which are first in `row`."""
    return ", ".join(f"{value:.9g}" for value in row[: len(_COLUMNS)])
