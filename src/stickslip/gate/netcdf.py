"""Read NetCDF 4 files, which are HDF5 files with named axes (dimensions), through `gate.hdf5`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .errors import GateError
from .files import opened
from .hdf5 import Hdf5Array, Hdf5Tree, hdf5_tree, is_hdf5
from .limits import LIMITS, check_count, check_regular

# Names of the HDF5 attributes in which NetCDF stores its axes. They are not returned as attributes of
# variables.
_AXES = ["REFERENCE_LIST", "CLASS", "DIMENSION_LIST", "NAME", "_Netcdf4Dimid", "_Netcdf4Coordinates"]
_OWN = frozenset([*_AXES, "_nc3_strict", "_NCProperties"])
_AXIS_ALONE = "This is a netCDF dimension but not a netCDF variable"
# Prefix in the file of the name of a variable that has the same name as an axis, but does not define this
# axis.
_OF_ANOTHER_AXIS = "_nc4_non_coord_"


class NetcdfVariable(NamedTuple):
    """A variable of a NetCDF file: names of its `axes`; its numbers as an array with these axes, `values`;
    and its `attributes` by name (texts or numbers)."""

    axes: tuple[str, ...]
    values: np.ndarray
    attributes: dict[str, Any]


class Netcdf(NamedTuple):
    """Content of a NetCDF file: its numeric variables by name, and the attributes of the file."""

    variables: dict[str, NetcdfVariable]
    attributes: dict[str, Any]


def read_netcdf(path: Path) -> Netcdf:
    """Return the variables of real numbers in the root group of a NetCDF 4 file; all other variables, such as
    texts, are left out.

    Raises:
        GateError: the file is no NetCDF 4, is damaged, refers to other files, or has more structure than
            `LIMITS` allows.
    """
    check_regular(path)
    if not is_hdf5(path):
        with opened(path) as file:
            classic = file.read(3) == b"CDF"
        if classic:
            raise GateError(f"{path}: NetCDF 3 (classic); 4 is read: nccopy -k nc4 OLD.nc NEW.nc makes one")
        raise GateError(
            f"{path}: not a readable NetCDF 4 file (cut off or damaged?): no HDF5 signature. "
            "Other formats are read by ss.read_recording"
        )
    with hdf5_tree(path) as tree:
        arrays = {n: one for n, one in tree.root.members.items() if isinstance(one, Hdf5Array)}
        check_count(path, len(arrays), LIMITS.channels, "variables")
        scales = {n for n, one in arrays.items() if one.attribute("CLASS") == "DIMENSION_SCALE"}
        axes = _axes(tree, arrays, scales)
        variables = {
            name.removeprefix(_OF_ANOTHER_AXIS): NetcdfVariable(
                axes[name], one.read(), tree.attributes(one, _OWN)
            )
            for name, one in arrays.items()
            if one.kind in ("i", "u", "f", "b") and not (name in scales and _is_axis_alone(one))
        }
        return Netcdf(variables, tree.attributes(tree.root, _OWN))


def _is_axis_alone(scale: Hdf5Array) -> bool:
    return str(scale.attribute("NAME")).startswith(_AXIS_ALONE)


def _axes(tree: Hdf5Tree, arrays: dict[str, Hdf5Array], scales: set[str]) -> dict[str, tuple[str, ...]]:
    """Return the names of the axes of each array, by the name of the array; an axis without a name is "axis
    0", "axis 1", ... by its number.

    Args:
        tree: the file.
        arrays: arrays of the root group by name.
        scales: names of the arrays that define axes. In the file, each of them lists the arrays and the
            numbers of their axes to which it belongs (attribute REFERENCE_LIST).
    """
    found = {name: [f"axis {k}" for k in range(len(one.shape))] for name, one in arrays.items()}
    for axis in sorted(scales):
        scale = arrays[axis]
        if len(scale.shape) == 1:
            found[axis] = [axis]
        for target, k in tree.pairs(scale, "REFERENCE_LIST"):
            named = found.get(target.name.removeprefix("/"), [])
            if 0 <= k < len(named):
                named[k] = axis
    return {name: tuple(axes) for name, axes in found.items()}


def netcdf_columns(path: Path) -> dict[str, np.ndarray]:
    """Return the numeric variables of a NetCDF file that do not define an axis, by name, each flattened to
    one column of floats.

    Raises:
        GateError: `read_netcdf` refuses the file.
    """
    found = read_netcdf(path).variables
    return {n: np.ravel(one.values).astype(float) for n, one in found.items() if one.axes != (n,)}
