"""Look-up tables of the step for a controller: voltage to step with its 95 % band, and step to voltage;
storage as CSV and as C."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..quantities.units import QuantityError, array_si, to_si

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]
_COLUMNS = ("net_step", "net_step_low", "net_step_high")
_ENDS = {"low": "lower", "high": "upper"}


class StepTable(NamedTuple):
    """Table of the net step over the voltage, SI, for linear interpolation.

    Attributes:
        voltages: V, ascending, from the least to the greatest value of the drive.
        steps: net step per period, in `unit`.
        low, high: ends of the 95 % band of the step; NaN if the map has no fit.
        interpolation_error: largest deviation of the steps from a linear interpolation between every second
            point, in `unit`. Unless the step is rough, it exceeds the interpolation error of the full table.
        conditions: frequency, load, direction and drive in words.
        title: title of the map, with the name of the actuator.
        unit: unit of steps and band: m, or rad for a rotary actuator.
    """

    voltages: Array
    steps: Array
    low: Array
    high: Array
    interpolation_error: float
    conditions: str
    title: str
    unit: str = "m"


def step_table(step_map: xr.Dataset) -> StepTable:
    """Return the table of a map over the voltage alone; choose along other dimensions with
    ``step_map.sel(...)``.

    Points without a steady step at either end are left out.

    Raises:
        QuantityError: the map has other dimensions, has fewer than three points with a steady step, or has a
            point without a steady step between two with one.
    """
    if "net_step" not in step_map or step_map["net_step"].dims != ("voltage",):
        dims = step_map["net_step"].dims if "net_step" in step_map else tuple(step_map.sizes)
        raise QuantityError(f"a table is of a map over voltage [V] alone, and this one is over {dims}")
    sorted_map = step_map.sortby("voltage")
    volts, steps = (sorted_map[name].values.astype(float) for name in ("voltage", "net_step"))
    there = np.flatnonzero(np.isfinite(steps))
    if there.size < 3:
        raise QuantityError(f"{there.size} voltages with a steady step are too few for a table")
    part = slice(there[0], there[-1] + 1)
    lost = volts[part][~np.isfinite(steps[part])]
    if lost.size:
        raise QuantityError(f"at {lost[0]:g} V there is no steady step: no table goes over that")
    volts, steps = volts[part], steps[part]
    low, high = (
        sorted_map[name].values[part] if name in sorted_map else np.full(volts.size, np.nan)
        for name in ("net_step_low", "net_step_high")
    )
    coarse = np.interp(volts, volts[::2], steps[::2])[: 2 * ((volts.size - 1) // 2) + 1]
    error = float(np.max(np.abs(coarse - steps[: coarse.size])))
    fixed = [
        f"{n} = {c.item():g} {c.attrs.get('units', '')}".strip()
        for n, c in step_map.coords.items()
        if not c.dims
    ]
    title = str(step_map.attrs.get("title", "steps"))
    drive = "; behind ".join(
        step_map.attrs[name] for name in ("waveform", "output") if name in step_map.attrs
    )
    unit = str(step_map["net_step"].attrs.get("units", "m"))
    return StepTable(volts, steps, low, high, error, "; ".join([*fixed, drive]), title, unit)


def step_at(table: StepTable, voltage: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the net step and the lower and upper end of its 95 % band at voltages [V], by linear
    interpolation.

    The three arrays have the shape of `voltage` and the unit of the table; they are NaN outside the table.
    """
    volts = array_si(voltage, "V", "voltage")
    found = [
        np.interp(volts, table.voltages, column, left=np.nan, right=np.nan)
        for column in (table.steps, table.low, table.high)
    ]
    return found[0], found[1], found[2]


def voltage_for(table: StepTable, step: float | str) -> float:
    """Return the voltage, V, at which the table has a given step, by linear interpolation.

    Args:
        table: the table.
        step: net step per period in the unit of the table, or a text with a unit.

    Raises:
        QuantityError: the table does not reach the step, or is not monotonic, so that several voltages have
            it.
    """
    wanted, unit = to_si(step, table.unit, "step"), table.unit
    way = _direction(table)
    if way == 0:
        raise QuantityError("step: the table is not monotone, so that several voltages have the same step")
    low, high = sorted((float(table.steps[0]), float(table.steps[-1])))
    if not low <= wanted <= high:
        raise QuantityError(
            f"step = {wanted:g} {unit} is out of range: the table has {low:g} {unit} to {high:g} {unit}"
        )
    return float(np.interp(wanted, table.steps[::way], table.voltages[::way]))


def save_step_table(table: StepTable, path: str | os.PathLike[str], name: str = "step") -> Path:
    """Write a table as CSV with a comment head (suffix .csv) or as a C header (.h), and return the path. An
    existing file is replaced.

    The header needs C99 and nothing else. It has the functions ``NAME_at(voltage)`` (net step),
    ``NAME_low(voltage)`` and ``NAME_high(voltage)`` (ends of the band) in the table's unit, NaN beyond the
    table, and for a monotone table ``NAME_voltage(step)`` in V.

    Args:
        table: the table.
        path: path of the file.
        name: prefix of the names in the header.

    Raises:
        QuantityError: another suffix, or `name` is not an identifier in C.
    """
    target = Path(path)
    if target.suffix == ".csv":
        target.write_text(_as_csv(table), encoding="utf-8")
    elif target.suffix == ".h":
        if re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,40}", name) is None:
            raise QuantityError(f"name = {name!r} is no name in C: letters, digits and _, a letter first")
        target.write_text(_as_header(table, name), encoding="utf-8")
    else:
        raise QuantityError(f"path: a table is written to .csv or .h, not to {target.name!r}")
    return target


def _direction(table: StepTable) -> int:
    change = np.diff(table.steps)
    return 1 if np.all(change > 0.0) else -1 if np.all(change < 0.0) else 0


def _said(table: StepTable) -> list[str]:
    band = "95 % band" if np.any(np.isfinite(table.low)) else "no band: the map had no fit"
    return [
        table.title,
        f"conditions: {table.conditions}",
        f"net step per period over voltage, to be joined by lines (these miss at most about "
        f"{table.interpolation_error:.2g} {table.unit}); {band}",
    ]


def _as_csv(table: StepTable) -> str:
    rows = np.column_stack([table.voltages, table.steps, table.low, table.high])
    lines = [f"# {line}" for line in _said(table)]
    lines.append(f"voltage [V],{','.join(f'{n} [{table.unit}]' for n in _COLUMNS)}")
    lines += [",".join("" if np.isnan(v) else repr(v) for v in row) for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def _as_header(table: StepTable, name: str) -> str:
    """Return the text of a C99 header with the table; `name` is the prefix of its names (see
    `save_step_table`)."""
    n, guard = table.voltages.size, f"{name.upper()}_TABLE_H"
    said = "\n".join(f" * {line.replace('*/', '* /')}" for line in _said(table))
    columns = {"voltages": table.voltages, "steps": table.steps, "lows": table.low, "highs": table.high}
    arrays = "\n".join(
        f"static const double {name}_{what}[{n}] = {{\n    {_numbers(values)}\n}};"
        for what, values in columns.items()
    )
    calls = [("at", "steps", f"step, {table.unit} per period")]
    calls += [(n, f"{n}s", f"{end} end of the 95 % band, {table.unit}") for n, end in _ENDS.items()]
    functions = [
        f"/* {meaning}, at a voltage [V] */\nstatic inline double {name}_{call}(double voltage)\n{{\n"
        f"    return {name}_line(voltage, {name}_voltages, {name}_{what}, {n});\n}}"
        for call, what, meaning in calls
    ]
    way = _direction(table)
    if way:
        pair = f"{name}_steps, {name}_voltages" if way > 0 else f"{name}_ascending, {name}_descending"
        if way < 0:
            functions.append(
                f"static const double {name}_ascending[{n}] = {{\n    {_numbers(table.steps[::-1])}\n}};\n"
                f"static const double {name}_descending[{n}] = {{\n    {_numbers(table.voltages[::-1])}\n}};"
            )
        functions.append(
            f"/* voltage [V] of a step [{table.unit} per period] */\n"
            f"static inline double {name}_voltage(double step)\n{{\n"
            f"    return {name}_line(step, {pair}, {n});\n}}"
        )
    return _HEADER.format(said=said, guard=guard, arrays=arrays, name=name, functions="\n\n".join(functions))


def _numbers(values: Array) -> str:
    texts = ["NAN" if np.isnan(v) else repr(v) for v in values.tolist()]
    return ",\n    ".join(", ".join(texts[i : i + 4]) for i in range(0, len(texts), 4))


_HEADER = """\
/*
{said}
 */
#ifndef {guard}
#define {guard}

#include <math.h>

{arrays}

/* y over x, which ascends, by lines; NAN beyond its ends. */
static inline double {name}_line(double at, const double *x, const double *y, int n)
{{
    int low = 0, high = n - 1;
    if (!(at >= x[0] && at <= x[n - 1])) {{
        return NAN;
    }}
    while (high - low > 1) {{
        int middle = (low + high) / 2;
        if (x[middle] <= at) {{
            low = middle;
        }} else {{
            high = middle;
        }}
    }}
    return y[low] + (y[high] - y[low]) * ((at - x[low]) / (x[high] - x[low]));
}}

{functions}

#endif
"""
