"""Read recordings in NeXus files, as `recording.nexus` writes them, through `gate.hdf5`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .errors import GateError
from .hdf5 import Hdf5Array, Hdf5Group, hdf5_tree
from .netcdf import Netcdf, NetcdfVariable

# Path in the file of the group that contains the samples.
DATA = "/entry/data"
# Path in the file of the group whose attributes are those of the recording.
ATTRIBUTES = "/entry/recording"
# Names of attributes that belong to the NeXus format: not to the recording (first), not to its variables
# (second).
OF_RECORDING = frozenset(["NX_class"])
OF_VARIABLE = frozenset(["target"])


def read_nexus(path: Path) -> Netcdf:
    """Return the variables and attributes of a recording in a NeXus file; the only axis of each variable is
    "time".

    Raises:
        GateError: the file is damaged, refers to other files, or was not written by this package.
    """
    with hdf5_tree(path) as tree:
        data, kept = _group(tree.root, DATA), _group(tree.root, ATTRIBUTES)
        if data is None or kept is None:
            raise GateError(f"{path}: no NeXus file of stickslip: it lacks the group {DATA} or {ATTRIBUTES}")
        variables = {
            name: NetcdfVariable(("time",), one.read(), tree.attributes(one, OF_VARIABLE))
            for name, one in data.members.items()
            if isinstance(one, Hdf5Array)
        }
        return Netcdf(variables, tree.attributes(kept, OF_RECORDING))


def _group(root: Hdf5Group, path: str) -> Hdf5Group | None:
    found: Any = root
    for label in path.strip("/").split("/"):
        found = found.members.get(label) if isinstance(found, Hdf5Group) else None
    return found if isinstance(found, Hdf5Group) else None
