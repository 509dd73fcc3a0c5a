"""Write MAT 7.3 files as MATLAB lays them out.

HDF5 behind 512 bytes of MATLAB's own; arrays column by column; classes as attributes; the elements of cells
and of arrays of structures as references into "#refs#".
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np


def write_mat73(path: Path, variables: dict[str, Any]) -> None:
    """2-D arrays, str, dict (a structure), list of dict (1 x k structures), tuple (a 1 x k cell)."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            _write(file, file, name, value)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def _write(file: h5py.File, group: h5py.Group, name: str, value: Any) -> None:
    if isinstance(value, dict):
        structure = group.create_group(name)
        structure.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, content in value.items():
            _write(file, structure, field, content)
    elif isinstance(value, list):
        structure = group.create_group(name)
        structure.attrs["MATLAB_class"] = np.bytes_("struct")
        for field in value[0]:
            references = [_reference(file, element[field]) for element in value]
            structure.create_dataset(field, data=np.array(references, dtype=h5py.ref_dtype).reshape(-1, 1))
    elif isinstance(value, tuple):
        references = np.array([_reference(file, element) for element in value], dtype=h5py.ref_dtype)
        group.create_dataset(name, data=references.reshape(-1, 1)).attrs["MATLAB_class"] = np.bytes_("cell")
    elif isinstance(value, str):
        codes = np.array([ord(sign) for sign in value], dtype=np.uint16).reshape(-1, 1)
        group.create_dataset(name, data=codes).attrs["MATLAB_class"] = np.bytes_("char")
    elif value.size == 0:
        empty = group.create_dataset(name, data=np.array(value.shape, dtype=np.uint64))
        empty.attrs["MATLAB_class"] = np.bytes_("double")
        empty.attrs["MATLAB_empty"] = np.uint8(1)
    else:
        group.create_dataset(name, data=value.T).attrs["MATLAB_class"] = np.bytes_("double")


def _reference(file: h5py.File, value: Any) -> h5py.Reference:
    group = file.require_group("#refs#")
    name = f"r{len(group)}"
    _write(file, group, name, value)
    return group[name].ref
