"""Measures at each point of a study: a walk, a steady step, or a function of the user's own."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..physics.actuator import Actuator
from ..physics.electronics.output import OutputStage
from ..quantities.units import QuantityError, array_si, optional_si, to_si, unit_for
from ..simulation.ensemble import simulate_ensemble
from ..simulation.errors import SimulationWarning
from ..simulation.members import checked_columns, labelled
from ..simulation.steady_members import steady_steps
from ..waveform.signal import Waveform
from .own import OwnFunction, own_function

Array = NDArray[np.float64]
Columns = Mapping[str, Array]


@dataclass(frozen=True)
class SteadySteps:
    """The steady step of each member; see `stickslip.steady_steps`.

    Args:
        model, waveform: common to all members, except in the fields that the study varies.
        tolerance: m (rad), on the net step.
        load: normal force over its reference, for all members, as for `steady_steps`.
        output: converter and amplifier that each drive passes.
    """

    model: Actuator
    waveform: Waveform
    tolerance: float | str = 1e-10
    load: Waveform | float = 1.0
    output: OutputStage | None = None

    def read(self, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
        """Return the values of a parameter in SI, and its attributes; raises QuantityError for an unknown
        name or unit."""
        return _read(self.model, self.waveform, name, values)

    def computed(self, columns: Columns) -> xr.Dataset:
        """Compute the steady step of members with these varied values (arrays by name); return a dataset over
        "member"."""
        return _quietly(
            lambda: steady_steps(
                self.model,
                self.waveform,
                parameters=columns,
                tolerance=to_si(self.tolerance, unit_for(self.model, "m"), "tolerance"),
                load=self.load,
                output=self.output,
                threads=1,
            )
        )


@dataclass(frozen=True)
class WalksFromRest:
    """A walk of each member from rest; see `stickslip.simulate_ensemble`.

    Args:
        model, waveform: what the members vary, in all fields that `simulate_ensemble` takes.
        duration: s; left out, that of each member's waveform.
        sample_rate: Hz, of trajectories; left out, only summaries are computed.
        tolerance: m (rad).
        load: normal force over its reference, for all members.
        max_steps: of each member.
    """

    model: Actuator
    waveform: Waveform
    duration: float | str | None = None
    sample_rate: float | str | None = None
    tolerance: float | str = 1e-9
    load: Waveform | float = 1.0
    max_steps: int = 2_000_000

    def read(self, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
        """Return the values of a varied parameter in SI, and its attributes, as `SteadySteps.read` does."""
        return _read(self.model, self.waveform, name, values)

    def computed(self, columns: Columns) -> xr.Dataset:
        """Return the results of members, over "member" (and "time", for trajectories)."""
        return _quietly(
            lambda: simulate_ensemble(
                self.model,
                self.waveform,
                optional_si(self.duration, "s", "duration"),
                parameters=columns,
                sample_rate=optional_si(self.sample_rate, "Hz", "sample_rate"),
                tolerance=to_si(self.tolerance, unit_for(self.model, "m"), "tolerance"),
                load=self.load,
                max_steps=self.max_steps,
                threads=1,
            )
        )


@dataclass(frozen=True)
class Own:
    """A user's function as the measure of a study.

    It is called with the varied values, arrays [member] by name, and returns results: arrays [member] by
    name, or `xarray.DataArray` with units in their attributes. Where it raises for several members, each is
    tried alone; a member that fails by itself has the status 1, and the error as its reason.

    Args:
        function: a function of a module or a file, or ``"FILE.py:NAME"``.
        units: SI unit of each varied value, by name.
    """

    function: Callable[..., Any] | str | OwnFunction
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "function", own_function(self.function))

    def read(self, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
        """Return a value as `SteadySteps` does; a string has the unit of the name."""
        unit = self.units.get(name, "")
        column = np.atleast_1d(array_si(values, unit, name))
        return column, {"units": unit} if unit else {}

    def computed(self, columns: Columns) -> xr.Dataset:
        """Return the function's results for members, with status and reason."""
        of_all = next(iter(columns.values())).size
        found, failed = one_by_one(lambda rows: self._of({n: c[rows] for n, c in columns.items()}), of_all)
        status = np.array([failed.get(m, "") != "" for m in range(of_all)], np.int8)
        flags = {"flag_values": [0, 1], "flag_meanings": "complete failed"}
        reasons = np.array([failed.get(m, "") for m in range(of_all)], dtype=str)
        return found.assign(status=("member", status, flags), reason=("member", reasons))

    def _of(self, columns: Columns) -> xr.Dataset:
        assert isinstance(self.function, OwnFunction)
        count = next(iter(columns.values())).size
        return as_dataset(self.function(columns), count, str(self.function))


Measure = SteadySteps | WalksFromRest | Own


def one_by_one(work: Callable[[slice], xr.Dataset], count: int) -> tuple[xr.Dataset, dict[int, str]]:
    """Return the results of `work` for members; if it raises, member by member, with the errors of failed
    ones.

    Raises:
        Exception: the error of `work` if all members fail.
    """
    try:
        return work(slice(0, count)), {}
    except Exception as error:
        if count == 1:
            return xr.Dataset(), {0: told(error)}
    made: dict[int, xr.Dataset] = {}
    failed: dict[int, str] = {}
    for m in range(count):
        try:
            made[m] = work(slice(m, m + 1))
        except Exception as error:
            failed[m] = told(error)
    if not made:
        return xr.Dataset(), failed
    first = next(iter(made.values()))
    empty = xr.full_like(first.astype(float), np.nan)
    return xr.concat([made.get(m, empty) for m in range(count)], dim="member"), failed


def told(error: BaseException) -> str:
    """Return an error as one line of text."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def as_dataset(found: Any, count: int, of: str) -> xr.Dataset:
    """Return the results of a user's function as a dataset over "member".

    Args:
        found: mapping of arrays [count], as the function returned it.
        count: number of members.
        of: name of the function, for errors.

    Raises:
        QuantityError: the result is not a mapping of arrays [member].
    """
    if not isinstance(found, Mapping):
        raise QuantityError(f"{of} returned a {type(found).__name__}, not arrays [member] by name")
    made = {}
    for name, values in found.items():
        column = np.asarray(values, dtype=float)
        if column.shape != (count,):
            raise QuantityError(f"{of}: {name} has the shape {column.shape}, not ({count},), one per member")
        made[str(name)] = ("member", column, dict(getattr(values, "attrs", {})))
    return xr.Dataset(made)


def _read(model: Actuator, waveform: Waveform, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
    column = checked_columns(model, waveform, {name: values})[name]
    return column, labelled(model, waveform, {name: column})[name][2]


def _quietly(work: Callable[[], xr.Dataset]) -> xr.Dataset:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SimulationWarning)  # of single members, which their columns say too
        return work()
