"""Export of a study's results to files for other programs: NetCDF, Parquet, CSV."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from ..quantities.progress import Progress, unheard
from ..quantities.units import QuantityError
from ..recording.replacing import replaced_whole
from .reading import blocks, open_study
from .store import Store


def export_study(
    store: str | os.PathLike[str], file: str | os.PathLike[str], progress: Progress = unheard
) -> int:
    """Write the results computed so far to a file; its ending selects the format.

    A ``.nc`` file contains everything, with fill values for members that are not computed. A ``.parquet``
    file (extra ``stickslip[parquet]``) or ``.csv`` file has a line for each computed member: its varied
    values and results, without results over further dimensions such as time. Tables are written task by task;
    NetCDF takes the memory of all results.

    Args:
        store: folder of the study.
        file: path of the new file; an existing file is replaced, and a missing folder is made.
        progress: called with a text and the finished fraction, after each task or, for NetCDF, at the end.

    Returns:
        The number of computed members.

    Raises:
        QuantityError: the ending is unknown, or no member is computed yet (Parquet).
        StudyError: the folder is not a store of a study, or the store is damaged.
        ModuleNotFoundError: pyarrow is missing (Parquet).
        OSError: the file cannot be written; the error names it.
    """
    there, file = Store(store), Path(file)
    writers = {".nc": _netcdf, ".parquet": _parquet, ".csv": _csv}
    if file.suffix not in writers:
        raise QuantityError(f"{file}: studies are exported as {', '.join(writers)}")
    there.check_results()
    file.parent.mkdir(parents=True, exist_ok=True)
    with replaced_whole(file) as temporary:
        return writers[file.suffix](there, temporary, progress)


def _netcdf(store: Store, file: Path, progress: Progress) -> int:
    whole = open_study(store.path).load()
    for name in [n for n, one in whole.items() if one.dtype.kind not in "fiu"]:
        whole[name] = whole[name].astype(object)  # the file then has strings of variable length
    # The file is made in memory, because HDF5 ends the whole process if a disk is full when it closes a file.
    file.write_bytes(whole.to_netcdf(None, engine="h5netcdf"))
    progress("writing", 1.0)
    return int((whole["status"] != -1).sum())


def _tables(store: Store, progress: Progress) -> Iterator[pd.DataFrame]:
    for i, (_, part) in enumerate(blocks(store)):
        yield _table(part, store.layout.dims)
        progress("writing", (i + 1) / store.layout.tasks)


def _table(part: xr.Dataset, dims: tuple[str, ...]) -> pd.DataFrame:
    """Return a table with a line for each computed member, and a column for each varied value and result.

    Uncomputed members (status -1) have no line.

    Args:
        part: results of one task.
        dims: dimensions of the study; variables with further dimensions are left out.
    """
    spread = xr.broadcast(*(part[n] for n in [*part.coords, *part.data_vars] if {*part[n].dims} <= {*dims}))
    columns = {str(one.name): one.transpose(*dims).values.ravel() for one in spread}
    texts = {n: np.asarray(c, dtype=object) if c.dtype.kind not in "fiu" else c for n, c in columns.items()}
    table = pd.DataFrame(texts)
    return table.loc[table["status"] != -1, :]


def _csv(store: Store, file: Path, progress: Progress) -> int:
    units = {str(n): str(v.attrs.get("units", "")) for n, v in open_study(store.path).variables.items()}
    count = 0
    with file.open("w", encoding="utf-8", newline="") as target:
        for number, table in enumerate(_tables(store, progress)):
            named = table.rename(columns={n: f"{n} [{units[n]}]" for n in table if units.get(str(n))})
            named.to_csv(target, index=False, header=number == 0)
            count += len(table)
    return count


def _parquet(store: Store, file: Path, progress: Progress) -> int:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ModuleNotFoundError:
        needs = 'Parquet needs pyarrow, which is not installed: pip install "stickslip[parquet]"'
        raise ModuleNotFoundError(needs, name="pyarrow") from None
    variables = open_study(store.path).variables
    count = 0
    with _closed() as writers:
        for frame in _tables(store, progress):
            if not len(frame):
                continue
            made = pa.Table.from_pandas(frame, preserve_index=False)
            fields = [
                field.with_metadata({"units": str(variables[field.name].attrs.get("units", ""))})
                for field in made.schema
            ]
            schema = pa.schema(fields)
            if not writers:
                writers.append(pq.ParquetWriter(file, schema))
            writers[0].write_table(made.cast(schema))
            count += len(frame)
        if not writers:
            raise QuantityError(f"{store.path}: nothing is computed yet")
    return count


@contextmanager
def _closed() -> Iterator[list[Any]]:
    """Yield an empty list for Parquet writers; close all writers in it at the end, also after an error."""
    writers: list[Any] = []
    try:
        yield writers
    finally:
        for writer in writers:
            writer.close()
