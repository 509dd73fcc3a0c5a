"""Reading of a study's results as an `xarray.Dataset`; each chunk is checked when it is read."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from .chunks import ChunkError
from .errors import StudyError
from .layout import TEXT, StudyVariable
from .store import Store


def open_study(path: str | os.PathLike[str]) -> xr.Dataset:
    """Return the results of a study computed so far; the values are read from the store on demand.

    The dataset equals that of `xarray.open_zarr`, but reading damaged results raises an error. For members
    that were not computed when the store was opened, status is -1, numbers are NaN and reasons are empty.

    Args:
        path: folder of the study's store.

    Raises:
        StudyError: the folder is not a store of a study, or its metadata are damaged. Reading damaged or
            misplaced results raises StudyError too.
    """
    store = Store(path)
    known = {name: (one.dims, values, one.about) for name, (one, values) in store.coordinates().items()}
    done = store.done().reshape(store.layout.counts)
    found = {
        one.name: (
            (*one.dims, *(dim for dim, _ in one.inner)),
            indexing.LazilyIndexedArray(_Results(store, one, done)),
            one.about,
        )
        for one in store.layout.variables
    }
    about = dict(store.about)
    beside = {*str(about.pop("coordinates", "")).split(), *known}
    try:
        return xr.Dataset({**found, **known}, attrs=about).set_coords(sorted(beside & {*found, *known}))
    except ValueError as error:  # the length of a coordinate differs from the size of its dimension
        raise StudyError(f"{store.path}: its coordinates are damaged: {error}") from None


def blocks(store: Store) -> Iterator[tuple[dict[str, slice], xr.Dataset]]:
    """Yield for each task the slice of each dimension that it covers, by name, and its results in memory.

    Tasks that are not computed are included, with fill values. Raises StudyError for damaged results.
    """
    whole = open_study(store.path)
    for number in range(store.layout.tasks):
        place = store.layout.place(number)
        yield place, whole.isel(place).load()


class _Results(BackendArray):
    """Array of one variable's results for xarray, read on demand from the finished tasks.

    Members of unfinished tasks have the variable's fill value. `done` is True for each task that was finished
    when the store was opened, over the numbers of tasks along each dimension.
    """

    def __init__(self, store: Store, variable: StudyVariable, done: NDArray[np.bool_]) -> None:
        self._store, self._variable, self._done = store, variable, done
        self.shape = store.layout.whole(variable)
        self.dtype = np.dtype(object if variable.dtype == TEXT else variable.dtype)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._selected
        )

    def _selected(self, key: tuple[int | slice, ...]) -> NDArray[Any]:
        """Return the values that an index or a slice along each dimension selects, from the needed tasks."""
        asked = [
            range(size)[one] if isinstance(one, slice) else range(one, one + 1)
            for one, size in zip(key, self.shape, strict=True)
        ]
        box = [range(min(one), max(one) + 1) if one else range(0) for one in asked]
        whole = np.full([len(one) for one in box], self._variable.missing, self.dtype)
        for number in self._tasks(box) if math.prod(whole.shape) else ():
            self._put(number, box, whole)
        return whole[
            tuple(
                slice(None, None, one.step) if isinstance(part, slice) else 0
                for part, one in zip(key, asked, strict=True)
            )
        ]

    def _tasks(self, box: list[range]) -> list[int]:
        """Return the numbers of finished tasks that together contain each value of a region once.

        Several tasks contain the same values if the variable lacks a dimension of the study; then only the
        first of them is returned.

        Args:
            box: the region, a range of indices along each dimension of the variable.
        """
        layout, dims = self._store.layout, self._variable.dims
        spans = dict(zip(dims, box, strict=False))
        parts = [
            range(spans[dim].start // part, -(-spans[dim].stop // part)) if dim in spans else range(count)
            for dim, part, count in zip(layout.dims, layout.task, layout.counts, strict=True)
        ]
        found = np.argwhere(self._done[tuple(slice(one.start, one.stop) for one in parts)])
        mine = [i for i, dim in enumerate(layout.dims) if dim in spans]
        first = np.unique(found[:, mine], axis=0, return_index=True)[1]
        at = found[first] + [one.start for one in parts]
        return np.atleast_1d(np.ravel_multi_index(tuple(at.T), layout.counts)).tolist()

    def _put(self, number: int, box: list[range], whole: NDArray[Any]) -> None:
        """Copy the results of one task that lie in a region into the array of the region.

        Args:
            number: number of the task.
            box: the region, a range of indices along each dimension of the variable.
            whole: array of the region, changed in place.

        Raises:
            StudyError: the task is damaged; the message tells how to repair it.
        """
        variable, place = self._variable, self._store.layout.place(number)
        try:
            values = self._store.read(number, variable)
        except ChunkError as error:
            raise StudyError(self._store.repair(number, str(error))) from None
        to, of = [], []
        for dim, span in itertools.zip_longest(variable.dims, box):
            part = place[dim] if dim is not None else slice(span.start, span.stop)
            low, high = max(part.start, span.start), min(part.stop, span.stop)
            to.append(slice(low - span.start, high - span.start))
            start = part.start if dim is not None else 0
            of.append(slice(low - start, high - start))
        whole[tuple(to)] = values[tuple(of)]
