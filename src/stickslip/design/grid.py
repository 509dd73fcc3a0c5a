"""Grid of a map: the points, and the fields of model and drive at each of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..physics.actuator import Actuator
from ..quantities.records import Quantity
from ..quantities.units import QuantityError, array_si, coordinate_of
from ..simulation.members import SCALES, by_name, checked_columns, labelled
from ..simulation.varied import record_names
from ..waveform.signal import Waveform
from .drives import default_drive, drive_columns

Array = NDArray[np.float64]

# Named axes of a map, in the order of the arguments of `step_map`: unit, symbol, meaning and range of each.
# Other parameters of the map have axes after these.
AXES = {
    "voltage": Quantity("V", "U", "voltage from the least to the greatest value of the drive", minimum=0),
    "frequency": Quantity("Hz", "f", "frequency of the drive", above=0),
    "load": Quantity("N", "F_L", "external force on the end-effector, positive towards +x"),
    "direction": Quantity("", "d", "1: the drive as it is, -1: mirrored in voltage"),
}


class MapGrid(NamedTuple):
    """Grid of a map: all combinations of the given values.

    Fields: `waveform`, the drive; `axes`, the given values by name, SI, arrays [values] or of no dimension
    for a single number; `dims`, names of the axes given as lists, the frequency first; `columns`, fields of
    model and drive by name, SI, arrays [points], in which the first of `dims` varies slowest; `about`, for
    each axis a mapping with the keys "units" and "long_name" (label).
    """

    waveform: Waveform
    axes: dict[str, Array]
    dims: tuple[str, ...]
    columns: dict[str, Array]
    about: dict[str, dict[str, str]]

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the shape of the grid, in the order of its dimensions."""
        return tuple(self.axes[name].size for name in self.dims)

    @property
    def frequency(self) -> Array:
        """Return the frequency of the drive at each point, Hz; NaN if the waveform has no period."""
        if "frequency" in self.columns:
            return self.columns["frequency"]
        period = getattr(self.waveform, "period", None)
        count = next(iter(self.columns.values())).size
        return 1.0 / self.columns.get("period", np.full(count, np.nan if period is None else period))


def grid_of(
    model: Actuator,
    waveform: Waveform | None,
    axes: Mapping[str, Any],
    parameters: Mapping[str, ArrayLike] | None,
) -> MapGrid:
    """Return the grid over the given values.

    Args:
        model, waveform: as for `step_map`.
        axes: values by the names of `AXES`, numbers or lists, in SI or with units; None for an axis that is
            not given.
        parameters: values of other fields of model, law or waveform by name, likewise.

    Raises:
        QuantityError: see `step_map`.
    """
    if not isinstance(model, Actuator):
        raise QuantityError(f"a map is of an Actuator, not of a {type(model).__name__}")
    meant = {name: q.along(coordinate_of(model)) for name, q in AXES.items()}
    found = {name: _axis(name, meant[name], v) for name, v in axes.items() if v is not None}
    if waveform is None:
        waveform = default_drive(model, "voltage" in found, "frequency" in found)
    about = {name: {"units": q.unit, "long_name": q.meaning} for name, q in meant.items() if name in found}
    for name, values in by_name({} if parameters is None else parameters).items():
        if name in AXES or name in SCALES:
            hint = {"load": "a normal force is `normal_load`", "drive_scale": "use voltage"}
            raise QuantityError(f"{name!r} is no parameter of a map: {hint.get(name, 'it is an argument')}")
        column = checked_columns(model, waveform, {name: values})[name]
        several = isinstance(values, list | tuple) or np.ndim(values) > 0
        found[name] = column if several else column.reshape(())
        about[name] = labelled(model, waveform, {name: column})[name][2]
    dims = tuple(sorted((name for name, a in found.items() if a.ndim), key=lambda name: name != "frequency"))
    mesh = np.meshgrid(*(found[name] for name in dims), indexing="ij")
    count = mesh[0].size if mesh else 1
    at = {name: array.ravel() for name, array in zip(dims, mesh, strict=True)}
    at |= {name: np.full(count, float(a)) for name, a in found.items() if not a.ndim}
    return MapGrid(waveform, found, dims, _columns(model, waveform, at, count), about)


def _axis(name: str, quantity: Quantity, values: Any) -> Array:
    given = array_si(values, quantity.unit, name)
    if given.ndim > 1 or given.size == 0:
        raise QuantityError(f"{name} must be a number or a list of them ({quantity.unit or 'no unit'})")
    checked = np.array([quantity.check(v, name) for v in given.reshape(-1).tolist()]).reshape(given.shape)
    if name == "direction" and not np.all(np.abs(checked) == 1.0):
        raise QuantityError(f"direction = {values!r}: it is 1 (as the drive is) or -1 (mirrored)")
    if np.unique(checked).size != checked.size:
        raise QuantityError(f"{name} has the same value twice")
    return checked


def _columns(model: Actuator, waveform: Waveform, at: Mapping[str, Array], count: int) -> dict[str, Array]:
    """Return the fields of waveform and model that a map varies or sets, by name, SI, arrays [points].

    The load of the map is added to the model's `external_force`.

    Args:
        model, waveform: actuator and drive.
        at: values of the axes and parameters at each point, by name, SI, arrays [points].
        count: number of points.
    """
    names = record_names(waveform)
    own = {name: column for name, column in at.items() if name in names and name not in AXES}
    drive = drive_columns(waveform, own, at.get("voltage"), at.get("frequency"), at.get("direction"))
    made = {name: np.broadcast_to(c, count).astype(float) for name, c in drive.items()}
    made |= {name: c for name, c in at.items() if name not in AXES and name not in names}
    if "load" in at:
        made["external_force"] = made.get("external_force", model.external_force) + at["load"]
    return made or {"external_force": np.full(count, model.external_force)}
