"""Maps of the steady step over voltage, frequency, load, direction and fields of the actuator."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..estimate.posterior import Posterior
from ..estimate.result import Fit
from ..physics.actuator import Actuator
from ..physics.electronics import OutputStage
from ..physics.electronics.stack import Stack
from ..quantities.progress import Progress, unheard
from ..quantities.records import of_kind, whole
from ..quantities.units import QuantityError, labelled_for
from ..simulation.demand import UNITS, electrical_demand
from ..simulation.errors import SimulationWarning
from ..simulation.steady_members import CONVERGED
from ..simulation.trajectory import checked_tolerance
from ..study.drawn import drawn_parameters
from ..waveform.signal import Waveform
from .grid import AXES, MapGrid, grid_of
from .solving import NOT_COMPUTED, STATUS, Solved, ends, intervals, solved
from .stored import Stored, solved_in_store

Array = NDArray[np.float64]
Extra = Literal["backlash", "backward_rate", "ringing", "ripple"]

# Smallest distance between the net steps of both directions, relative to the tolerance, at which their
# `inequality` is computed.
KNOWN = 100.0

LABELS = {
    "net_step": ("m", "net step per period"),
    "speed": ("m/s", "mean speed"),
    "backlash": ("m", "farthest way back within a period"),
    "backward_rate": ("", "farthest way back over the way forward"),
    "ringing": ("m", "largest swing back after the slip"),
    "ripple": ("m", "departure from a uniform motion, peak to peak"),
    "error_estimate": ("m", "how far the net step may be off, by a coarser integration"),
    "net_step_low": ("m", "net step, 2.5 % quantile"),
    "net_step_high": ("m", "net step, 97.5 % quantile"),
    "speed_low": ("m/s", "mean speed, 2.5 % quantile"),
    "speed_high": ("m/s", "mean speed, 97.5 % quantile"),
    "draws_converged": ("", "draws with a steady step"),
    "inequality": ("", "step forward minus step back, over their mean"),
    **UNITS,
}


def step_map(
    model: Actuator,
    waveform: Waveform | None = None,
    *,
    voltage: ArrayLike | None = None,
    frequency: ArrayLike | None = None,
    load: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    quantities: Iterable[Extra] = (),
    output: OutputStage | None = None,
    stack: Stack | None = None,
    fit: Fit | Posterior | Mapping[str, ArrayLike] | None = None,
    draws: int = 200,
    seed: int = 0,
    normal_load: Waveform | float = 1.0,
    tolerance: float | str = 1e-10,
    threads: int | None = None,
    store: str | os.PathLike[str] | None = None,
    scheduler: str | None = None,
    progress: Progress = unheard,
) -> xr.Dataset:
    """Return the steady step over all combinations of the given values.

    Each of voltage, frequency, load, direction and the parameters is a list of values, which becomes a
    dimension, or one number; all in SI or as strings with units. For a rotary actuator, rad replaces m and N
    m replaces N everywhere.

    Args:
        model: the actuator.
        waveform: periodic (one with a `period`), V; by default a `Sawtooth` with a jump that rests at 0 V, or
            where the model's range of voltage is nearest to 0 V; voltage and frequency are then required.
        voltage: V, from the least to the greatest value of the drive. Points beyond the model's `min_voltage`
            and `max_voltage` are refused, with the reason.
        frequency: Hz.
        load: N, external force on the end-effector, positive towards +x as the model's `external_force`, to
            which it is added: -0.1 N is against a walk forward.
        direction: 1, the drive as it is, and -1, its mirror image in voltage (see `design.drives`), which
            walks the other way. With both there is also `inequality`.
        parameters: values of other fields of the model, its law or the waveform, by name ("incline",
            "end_effector_mass", "sigma_0", "rise_fraction"), as for `steady_steps`.
        quantities: "backlash", "backward_rate", "ringing" and "ripple" cost about as much again; see
            `design.motion`.
        output: converter and amplifier that the drive of each point passes (`OutputStage.behind`). The period
            is then the nearest whole number of updates, in the speed too. By default the drive reaches the
            piezo as it is.
        stack: the piezo's numbers, for current, energy and heat; the drive must not jump.
        fit: uncertain parameters, for an interval of the step at every point: a result of
            `identify_friction` or `identify_step` with the model's values, a `posterior`, or arrays by name
            (``prior.draws(500)`` of a contact).
        draws, seed: number of draws of these parameters, at least 40 and the same at all points, and their
            seed.
        normal_load: normal force over its reference, for all points: a number, or a waveform as for
            `steady_orbit`, into whose period it has to fit.
        tolerance: m, on the net step.
        threads: number of threads, by default one per processor; with a `store`, number of processes.
        store: folder in which the points are kept as studies (see `run_study`), ``steps.zarr`` and, with a
            fit, ``draws.zarr``: an interrupted call resumes. Not with `quantities`.
        scheduler: address of a dask scheduler whose workers fill the store.
        progress: called after each block of points with the current step and the done share.

    Returns:
        Dataset over the given dimensions: net_step (m per period, positive towards +x; NaN if not found),
        speed (m/s), error_estimate (m), status (0 converged; see its flag_meanings) and reason (empty where
        converged). On demand backlash, ringing, ripple (m), backward_rate; peak_current, rms_current (A),
        energy_per_step (J), heat (W) and temperature_rise (K); net_step_low, net_step_high, speed_low,
        speed_high (ends of the 95 % interval; NaN where fewer than nine draws of ten converged) and
        draws_converged; inequality, without the dimension of the direction (NaN where the net steps of both
        directions differ by less than a hundred tolerances). After Ctrl-C the points that are not computed
        have the status "not_computed", and ``attrs["interrupted"]`` is 1. A SimulationWarning is given then,
        and for points whose error estimate exceeds the tolerance.

    Raises:
        QuantityError: a value is out of range, or a name is unknown; see also `steady_orbit`.
        StudyDiffers, StudyError: the store belongs to another map, or cannot be used; see `run_study`.
    """
    tolerance = checked_tolerance(model, tolerance)
    extras = _extras(quantities)
    given = dict(zip(AXES, (voltage, frequency, load, direction), strict=True))
    grid = grid_of(model, waveform, given, parameters)
    played = grid.frequency
    if output is not None:
        played = 1.0 / of_kind(output, OutputStage, "output").played_period(1.0 / played)
    drawn = {} if fit is None else _drawn(fit, model, grid, draws, seed)
    demand = {} if stack is None else _demand(grid, stack, output)
    common = (model, grid.waveform, grid.columns, tolerance, normal_load, threads, output)
    stored = _stored(store, scheduler, extras)
    share = 1.0 / (1.0 + (draws if drawn else 0))

    def points(doing: str, done: float) -> None:
        progress(doing, share * done)

    found = solved(*common, points, extras) if stored is None else solved_in_store(common, stored, points)
    values: dict[str, Any] = {
        "net_step": found.steps,
        "speed": found.steps * played,
        **found.beside,
        **demand,
        "error_estimate": found.errors,
    }
    interrupted = found.interrupted
    if drawn and not interrupted:

        def rest(doing: str, done: float) -> None:
            progress(doing, share + (1.0 - share) * done)

        if stored is None:
            low, high, count, interrupted = intervals(common, drawn, rest)
        else:
            of_draws = solved_in_store(common, stored, rest, drawn)
            (low, high, count), interrupted = ends(of_draws.steps), of_draws.interrupted
        values |= {"net_step_low": low, "net_step_high": high}
        values |= {"speed_low": low * played, "speed_high": high * played}
        values["draws_converged"] = count
    made = _dataset(grid, found, values, tolerance).assign_attrs(
        title=f"map of the step of {model.name or type(model).__name__}",
        waveform=repr(grid.waveform),
        tolerance=tolerance,
        interrupted=int(interrupted),
    )
    if output is not None:
        made.attrs["output"] = repr(output)
    if drawn:
        made.attrs["draws"] = draws
    labelled_for(model, made)
    _warn(found, tolerance)
    if interrupted and not found.interrupted:
        warnings.warn("stopped: the draws of the fit are not complete", SimulationWarning, stacklevel=2)
    return made


def _extras(quantities: Iterable[Extra]) -> tuple[str, ...]:
    names = (quantities,) if isinstance(quantities, str) else tuple(quantities)
    for name in names:
        if name not in get_args(Extra):
            raise QuantityError(f"quantities: there are {', '.join(get_args(Extra))}, not {name!r}")
    return names


def _stored(store: Any, scheduler: str | None, extras: tuple[str, ...]) -> Stored | None:
    if store is None:
        if scheduler is not None:
            raise QuantityError("a scheduler needs a store, the folder that its workers see")
        return None
    if extras:
        raise QuantityError(f"quantities: {', '.join(extras)} cannot be kept in a store")
    return Stored(Path(store), scheduler)


def _drawn(fit: Any, model: Actuator, grid: MapGrid, draws: int, seed: int) -> dict[str, Array]:
    # Fewer than 40 draws do not define the ends of a 95 % interval.
    drawn = drawn_parameters(fit, model, whole(draws, "draws", 40, 100_000), seed)
    for name in drawn:
        if name in grid.columns:
            raise QuantityError(f"{name!r} varies over the map, and over the draws of the fit: only one can")
    return drawn


def _demand(grid: MapGrid, stack: Stack, output: OutputStage | None) -> dict[str, Array]:
    count = next(iter(grid.columns.values())).size
    return electrical_demand(grid.waveform, grid.columns, stack, count, output)


def _dataset(grid: MapGrid, found: Solved, values: Mapping[str, Array], tolerance: float) -> xr.Dataset:
    dims, order = grid.dims, [name for name in grid.axes if name in grid.dims]
    coords = {
        name: ((name,) if name in dims else (), axis, grid.about[name]) for name, axis in grid.axes.items()
    }
    data: dict[str, Any] = {
        name: (dims, np.asarray(column).reshape(grid.shape), {"units": unit, "long_name": meaning})
        for name, column in values.items()
        for unit, meaning in (LABELS[name],)
    }
    flags = {"flag_values": list(range(len(STATUS))), "flag_meanings": " ".join(STATUS)}
    data["status"] = (dims, found.status.reshape(grid.shape), flags)
    data["reason"] = (dims, np.array(found.reasons, dtype=str).reshape(grid.shape))
    made = xr.Dataset(data, coords)
    if "direction" in dims and {1.0, -1.0} <= {*grid.axes["direction"].tolist()}:
        there, back = (made["net_step"].sel(direction=d, drop=True) for d in (1.0, -1.0))
        apart = there - back
        unequal = (2.0 * (there + back) / apart).where(np.abs(apart) > KNOWN * tolerance)
        unit, meaning = LABELS["inequality"]
        made["inequality"] = unequal.assign_attrs(units=unit, long_name=meaning)
    return made.transpose(*order)


def _warn(found: Solved, tolerance: float) -> None:
    off = int(np.sum((found.status == CONVERGED) & ~(found.errors <= tolerance)))
    if off:
        text = f"{off} of {found.status.size} points are not shown to be within the tolerance"
        warnings.warn(f"{text}: see error_estimate", SimulationWarning, stacklevel=3)
    left = int(np.sum(found.status == NOT_COMPUTED))
    if left:
        warnings.warn(
            f"stopped: {left} of {found.status.size} points are not computed", SimulationWarning, stacklevel=3
        )
