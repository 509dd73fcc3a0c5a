"""Measures of a study: the computation for each member, a walk, a steady step, or a user's function."""

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
    """Measure: the steady step of each member, computed by `stickslip.steady_steps`.

    The steady step is the net displacement per period of the periodic motion.

    Args:
        model, waveform: actuator and drive of all members, except for the fields that the study varies.
        tolerance: allowed error of the net step, m, or rad for a rotary actuator.
        load: normal force relative to its reference, for all members: a number or a waveform, as for
            `steady_steps`.
        output: converter and amplifier between each drive signal and the piezo; None: the drive acts
            directly.
    """

    model: Actuator
    waveform: Waveform
    tolerance: float | str = 1e-10
    load: Waveform | float = 1.0
    output: OutputStage | None = None

    def read(self, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
        """Return the values of a parameter in SI [n], and its attributes `units` and `long_name`.

        Raises QuantityError for an unknown name or unit.
        """
        return _read(self.model, self.waveform, name, values)

    def computed(self, columns: Columns) -> xr.Dataset:
        """Compute the steady steps of members; return the results of `steady_steps` over "member".

        A failed member raises no error: its status and reason state the failure.

        Args:
            columns: varied values by name, arrays [members] in SI.
        """
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
    """Measure: a walk of each member from rest, simulated by `stickslip.simulate_ensemble`.

    Args:
        model, waveform: actuator and drive of all members, except for the fields that the study varies.
        duration: simulated time, s; by default the duration of the waveform, without `sample_rate` of each
            member's own waveform.
        sample_rate: sample rate of trajectories, Hz; by default there are only results with one number per
            member, no trajectories.
        tolerance: allowed error of the position, m, or rad for a rotary actuator.
        load: normal force relative to its reference, for all members: a number or a waveform.
        max_steps: largest number of integration steps of each member; a member that needs more fails.
    """

    model: Actuator
    waveform: Waveform
    duration: float | str | None = None
    sample_rate: float | str | None = None
    tolerance: float | str = 1e-9
    load: Waveform | float = 1.0
    max_steps: int = 2_000_000

    def read(self, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
        """Return the values of a parameter in SI [n], and its attributes `units` and `long_name`.

        Raises QuantityError for an unknown name or unit.
        """
        return _read(self.model, self.waveform, name, values)

    def computed(self, columns: Columns) -> xr.Dataset:
        """Simulate members; return the results of `simulate_ensemble` over "member".

        Trajectories are over "time", too. A failed member raises no error: its status and reason state the
        failure.

        Args:
            columns: varied values by name, arrays [members] in SI.
        """
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
    """Measure: a user's function.

    The function is called with the varied values, arrays [member] by name, and returns results: arrays
    [member] by name, or `xarray.DataArray` with units in their attributes. If it raises an error for several
    members, it is called for each of them alone. A member that fails then has the status 1, the error as its
    reason, and NaN as results.

    Args:
        function: a function of a module or a file, or ``"FILE.py:NAME"``.
        units: SI unit of each varied value, by name; values without a unit here are plain numbers.

    Raises:
        RegistryError: other processes cannot import the function.
    """

    function: Callable[..., Any] | str | OwnFunction
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "function", own_function(self.function))

    def read(self, name: str, values: ArrayLike) -> tuple[Array, dict[str, str]]:
        """Return the varied values of a name in the unit that `units` states [n], and their attributes.

        The attributes have the key `units`, or none for a plain number. Raises QuantityError for values with
        a unit of another kind, such as V for m.
        """
        unit = self.units.get(name, "")
        column = np.atleast_1d(array_si(values, unit, name))
        return column, {"units": unit} if unit else {}

    def computed(self, columns: Columns) -> xr.Dataset:
        """Call the function for members; return its results over "member", with status and reason.

        The status is 0 (complete) or 1 (failed); the reason is "" for complete members.

        Args:
            columns: varied values by name, arrays [members].
        """
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
    """Compute all members in one call of `work`; if it raises an error, compute each member alone.

    So one bad member does not lose the results of the others.

    Args:
        work: function from a slice of member indices to the results of these members over "member".
        count: number of members.

    Returns:
        The results over "member", NaN for failed members, or an empty dataset if all fail; and the errors of
        failed members as text, by index of the member.
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
    """Return an error as one line of text: its type and message."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


def as_dataset(found: Any, count: int, of: str) -> xr.Dataset:
    """Convert the results of a user's function to a dataset over "member"; attributes such as units are kept.

    Args:
        found: what the function returned: it must be a mapping of arrays [count] by name.
        count: number of members.
        of: name of the function, for errors.

    Raises:
        QuantityError: the result is no mapping, or an array has another shape than [count].
        ValueError, TypeError: a result contains something other than numbers.
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
        # These warnings say that members failed, and so do the status and reason of these members.
        warnings.simplefilter("ignore", SimulationWarning)
        return work()
