"""Definition of a study: its members, the computation for each member, and the results to keep."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..quantities.units import QuantityError
from .errors import StudyError
from .layout import TEXT, Layout, StudyVariable, cut, usual
from .measures import Columns, Measure, as_dataset, one_by_one
from .own import OwnFunction, own_function
from .points import Part, StudyAxis, axes_of

if TYPE_CHECKING:
    import xarray as xr

# Name of the status of members that were computed, but for which the user's summary function failed.
SUMMARY_FAILED = "summary_failed"
_STATUS = ("status", "reason")


@dataclass(frozen=True)
class Study:
    """Many members of one kind, and the results to keep.

    Args:
        points: a `Grid`, a `Random` design, `Draws`, or several of them: all combinations.
        measure: computation for each member: `SteadySteps`, `WalksFromRest` or a function of your `Own`.
        summary: a function of your own, or ``"FILE.py:NAME"``. The function is given the dataset of some
            members (the results of `measure`, with trajectories if requested, and the varied values). It
            returns arrays [member] by name, or `xarray.DataArray` with units in their attributes.
        keep: names of the results to keep besides status and reason; by default all, except trajectories
            if there is a summary. The summary's own results are always kept.
        task: largest number of members per task. A worker computes one task at a time, and a crash loses
            the unfinished tasks. The default depends on the study alone, not on the machine.
        title: title of the study.

    Raises:
        QuantityError: `task` is no whole number above 0.
        RegistryError: `summary` is no function that other processes can import.
    """

    points: Part | Sequence[Part]
    measure: Measure
    summary: Callable[..., Any] | str | OwnFunction | None = None
    keep: Sequence[str] = ()
    task: int | None = None
    title: str = ""

    def __post_init__(self) -> None:
        if self.summary is not None:
            object.__setattr__(self, "summary", own_function(self.summary))
        task = self.task
        if task is not None and (isinstance(task, bool) or not (isinstance(task, int) and task > 0)):
            raise QuantityError(f"task = {task!r} must be a whole number of members > 0")

    def __getstate__(self) -> dict[str, Any]:
        """Return the arguments by name, for pickling; cached axes and results of the trial are left out."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @cached_property
    def axes(self) -> list[StudyAxis]:
        """Return the varied quantities, one `StudyAxis` per dimension of the study.

        Raises QuantityError for a name or value that is not allowed.
        """
        return axes_of(self.points, self.measure.read)

    @property
    def dims(self) -> tuple[str, ...]:
        return tuple(axis.dim for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(axis.size for axis in self.axes)

    def columns(self, place: dict[str, slice]) -> Columns:
        """Return the varied values of a block of members by name, each an array [members] in SI.

        In the arrays, the index of the last dimension varies fastest.

        Args:
            place: by dimension, the slice of indices that the block covers.
        """
        parts = [axis.at(place[axis.dim].start, place[axis.dim].stop) for axis in self.axes]
        shape, found = tuple(part.shape[1] for part in parts), {}
        for i, (axis, part) in enumerate(zip(self.axes, parts, strict=True)):
            aligned = (slice(None), *((slice(None) if i == k else None) for k in range(len(parts))))
            spread = np.broadcast_to(part[aligned], (len(axis.names), *shape)).reshape(len(axis.names), -1)
            found |= dict(zip(axis.names, spread.astype(float), strict=True))
        return found

    def computed(self, columns: Columns) -> xr.Dataset:
        """Compute some members; return the results to keep over "member", with status and reason last.

        A member that cannot be computed has a status other than 0, and its error as the reason. A result with
        the name of a varied value is left out. If a user's function fails for all members, its results are
        missing, also those that `keep` names.

        Args:
            columns: varied values of the members by name, arrays [members] in SI, as from `columns`.

        Raises:
            QuantityError: `keep` names an unknown result, or a result of the summary has the name of another
                result or of a varied value.
        """
        found, own = self.measure.computed(columns), []
        known = {*found} > {*_STATUS}  # False if a user's function has failed for all members
        found = found.drop_vars([name for name in columns if name in found])
        if self.summary is not None:
            made, found = self._summarised(found, columns)
            own = [str(name) for name in made]
            known = known and bool(own)
            for name in own:
                if name in found or name in columns:
                    raise QuantityError(f"{self.summary} returned {name!r}, which there is already")
            found = found.assign(made)
        missing = [name for name in self.keep if name not in found]
        if missing and known:
            raise QuantityError(f"keep: there is no {missing[0]!r}; there are {', '.join(map(str, found))}")
        kept = [*(name for name in self.keep if name not in missing), *own]
        if not self.keep:
            kept = [str(n) for n in found if self.summary is None or found[n].dims == ("member",)]
        return found[[name for name in dict.fromkeys(kept) if name not in _STATUS] + list(_STATUS)]

    def layout(self) -> Layout:
        """Return the layout of the results in a store; names and shapes are found by computing two members.

        Raises:
            QuantityError: a part of the study is impossible.
            StudyError: names and shapes are unknown, because a user's function fails for both members or,
                if there is a summary, because a member fails.
        """
        made = self._trial
        if not set(made) - set(_STATUS) or (self.summary is not None and set(made["reason"].values) - {""}):
            raise StudyError(f"the first two members fail: {made['reason'].values[0]}")
        known = [axis for axis in self.axes if axis.drawn is not None]
        varied = [StudyVariable(n, (a.dim,), (), "float64", a.about[n]) for a in known for n in a.names]
        found = [
            StudyVariable(
                str(name),
                self.dims,
                tuple((str(dim), int(one.sizes[dim])) for dim in one.dims if dim != "member"),
                TEXT if name == "reason" else "int8" if name == "status" else "float64",
                {k: _listed(v) for k, v in one.attrs.items()},
            )
            for name, one in made.items()
        ]
        found.sort(key=lambda v: v.name == "status")
        of_one = sum(8 * math.prod(size for _, size in v.inner) for v in found)
        task = self.task or usual(math.prod(self.shape), of_one)
        return Layout(self.dims, self.shape, cut(self.shape, task), (*varied, *found))

    def inner(self) -> dict[str, xr.DataArray]:
        """Return the coordinates of dimensions that results have besides "member", such as time, by name.

        They are found by computing two members, as for `layout`.
        """
        made = self._trial
        return {str(name): c for name, c in made.coords.items() if name != "member"}

    @cached_property
    def _trial(self) -> xr.Dataset:
        """Return the results of the first two members, which show names, units and shapes of all results.

        A study of one member has only this one.
        """
        place = {axis.dim: slice(0, min(2, axis.size)) for axis in self.axes}
        return self.computed({name: column[:2] for name, column in self.columns(place).items()})

    def _summarised(self, found: xr.Dataset, columns: Columns) -> tuple[xr.Dataset, xr.Dataset]:
        """Apply the user's summary function to the results `found` of some members.

        The function is given `found` together with the varied values `columns`, arrays [members] by name.

        Returns:
            The summary over "member" (NaN where the function failed), and `found`, in which complete members
            with a failed summary have the status `SUMMARY_FAILED` and the error as reason.
        """
        assert isinstance(self.summary, OwnFunction)
        summary, given = self.summary, found.assign({n: ("member", c) for n, c in columns.items()})

        def work(rows: slice) -> xr.Dataset:
            some = given.isel(member=rows)
            return as_dataset(summary(some), some.sizes["member"], str(summary))

        made, failed = one_by_one(work, next(iter(columns.values())).size)
        status, reason = found["status"].copy(deep=True), found["reason"].astype(object)
        code = max(map(int, status.attrs["flag_values"])) + 1
        status.attrs["flag_values"] = [*status.attrs["flag_values"], code]
        status.attrs["flag_meanings"] += f" {SUMMARY_FAILED}"
        for m, text in failed.items():
            if status.values[m] == 0:
                status.values[m], reason.values[m] = code, text
        return made, found.assign(status=status, reason=reason)


def _listed(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else value
