"""Creation of a study's store, before the first task: all metadata, and the varied values of grids and draws.

The varied values of a random design are written later, with each task.
"""

from __future__ import annotations

import json
import os
import shutil
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..quantities.units import QuantityError
from .chunks import MOST_METADATA_BYTES, NEEDS, part_beside
from .description import identity
from .errors import StudyError
from .layout import TEXT, Layout, check_layout, layout_text
from .points import StudyAxis
from .sealing import file_hash, sealed
from .store import FORMAT

if TYPE_CHECKING:
    import xarray as xr


def create(
    path: str | os.PathLike[str],
    description: Mapping[str, Any],
    layout: Layout,
    axes: list[StudyAxis],
    inner: Mapping[str, xr.DataArray],
    title: str,
) -> None:
    """Create a store with all metadata and no results; a store that another process has just created stays.

    The store is written to a temporary folder, which is then renamed, so that it appears complete. Missing
    parent folders are made.

    Args:
        path: folder of the new store.
        description: description of the study, from `described`.
        layout: variables, dimensions and tasks of the study.
        axes: varied quantities of the study.
        inner: coordinates of the results' own dimensions, such as time, by name.
        title: title of the study; "" for none.

    Raises:
        QuantityError: a name cannot be the name of a variable, the metadata or a task's results are too
            large, or there are too many tasks or dimensions.
        StudyError: the folder contains something else, or cannot be written, for example on a full disk.
        ModuleNotFoundError: the package zarr is not installed.
    """
    path = Path(path)
    begun = part_beside(path)
    try:
        check_layout(layout)
    except ValueError as error:
        raise QuantityError(f"the study cannot be stored: {error}") from None
    manifest = {
        "format": FORMAT,
        "identity": identity(description),
        "description": description,
        "layout": json.loads(layout_text(layout)),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _metadata(begun, manifest, layout, axes, inner, title)
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()  # some operating systems cannot rename a folder to the name of an existing empty one
        begun.rename(path)
    except OSError as error:
        if not (path / "zarr.json").exists():
            raise StudyError(f"{path}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(begun, ignore_errors=True)


def _metadata(
    path: Path,
    manifest: dict[str, Any],
    layout: Layout,
    axes: list[StudyAxis],
    inner: Mapping[str, xr.DataArray],
    title: str,
) -> None:
    try:
        import zarr
        from zarr.codecs import Crc32cCodec, GzipCodec
    except ModuleNotFoundError:
        raise ModuleNotFoundError(NEEDS.format("zarr", "study"), name="zarr") from None
    beside = [n for a in axes if a.dim not in a.names for n in a.names]
    attributes = {
        "title": title or "study",
        "coordinates": " ".join(beside),
        "stickslip_version": __version__,
    }
    group = zarr.create_group(path, zarr_format=3, attributes=attributes)
    for variable in layout.variables:
        of_text = variable.dtype == TEXT
        group.create_array(
            variable.name,
            shape=layout.whole(variable),
            chunks=layout.chunk(variable),
            dtype="string" if of_text else variable.dtype,
            compressors=[GzipCodec(level=1), Crc32cCodec()] if of_text else [Crc32cCodec()],
            fill_value=variable.missing,
            dimension_names=(*variable.dims, *(dim for dim, _ in variable.inner)),
            attributes=variable.about,
        )
    known: list[tuple[str, tuple[str, ...], NDArray[np.float64], dict[str, Any]]] = [
        (name, (axis.dim,), values, {**axis.about[name]})
        for axis in axes
        if axis.values is not None
        for name, values in zip(axis.names, axis.values, strict=True)
    ]
    known += [(n, tuple(map(str, c.dims)), c.values, dict(c.attrs)) for n, c in inner.items()]
    for name, dims, values, about in known:
        made = group.create_array(
            name,
            shape=values.shape,
            chunks=values.shape,
            dtype="float64",
            compressors=[Crc32cCodec()],
            fill_value=float("nan"),
            dimension_names=dims,
            attributes=about,
        )
        made[...] = values
    written = sorted(one for one in path.rglob("*") if one.is_file() and one.parent != path)
    names = [one.relative_to(path).as_posix() for one in written]
    manifest["files"] = {name: file_hash(path, name) for name in names}
    with warnings.catch_warnings():
        # Consolidated metadata (those of all arrays in one file) open faster. The library warns that they are
        # not part of format 3; readers that do not know them read the file of each array.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(str(path))
    content = json.loads((path / "zarr.json").read_bytes())
    content["attributes"]["study"] = json.dumps(manifest)
    text = sealed(content)
    if len(text) > MOST_METADATA_BYTES:
        raise QuantityError(
            f"the study cannot be stored: its metadata would have {len(text) / 1e6:.0f} MB; up to "
            f"{MOST_METADATA_BYTES / 1e6:g} MB are possible: take fewer results, or shorter attributes"
        )
    (path / "zarr.json").write_text(text, encoding="utf-8")
