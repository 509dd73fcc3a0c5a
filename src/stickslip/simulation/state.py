"""State at the start or end of a trajectory: conversion to and from the solver's numbers."""

from __future__ import annotations

import hashlib
import json
import warnings
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..friction import element, project
from ..gate.errors import damaged
from ..gate.text import load_json
from ..quantities.records import of_kind
from ..quantities.units import QuantityError
from ..waveform.drive import Drive, evaluate
from ..waveform.pieces import SLIVER
from .errors import SimulationWarning
from .models import RelativeLoad, System

if TYPE_CHECKING:
    import xarray as xr

# Deflection of a bristle in a `State` over the largest one that sliding can cause. Up to ROUNDED, the errors
# of a trajectory explain the excess, and the deflection stays. Up to FARTHEST, the state may come from a run
# with other friction, and the deflection is moved to its bound. Above, the state is refused.
ROUNDED, FARTHEST = 1.01, 2.0


class State(NamedTuple):
    """State of an actuator or a pulled slider at a time, in SI (m, or rad for a rotary actuator). A position,
    velocity or deflection that is None has its value at rest.

    Fields: `time` [s] of the drive; `error_estimate` [m], accumulated error of the end-effector's position;
    `resume`, numbers of the solver with which a trajectory continues without any difference, and `made_by`,
    the hash of the run to which they belong (see `maker`); `further`, position [m] and velocity [m/s] of each
    mode of a stage with several modes, then the states of the stop operators of a `MaxwellCapacitor`, in 1e-7
    m per volt (empty: at rest).
    """

    time: float = 0.0
    stage_position: float | None = None
    stage_velocity: float | None = None
    end_effector_position: float | None = None
    end_effector_velocity: float | None = None
    bristle_deflections: tuple[float, ...] | None = None
    error_estimate: float = 0.0
    resume: tuple[float, ...] = ()
    made_by: str = ""
    further: tuple[float, ...] = ()


REST = State()


def final_state(trajectory: xr.Dataset) -> State:
    """Return the state at the end of a trajectory, to be given to `simulate` as `initial_state`.

    Raises:
        QuantityError: the data do not come from `simulate`, or the trajectory ended early.
    """
    text = trajectory.attrs.get("final_state")
    if text is None:
        raise QuantityError(
            "there is no final state: attrs['final_state'] is written by simulate, of a complete trajectory"
        )
    with damaged(QuantityError, "attrs['final_state'] is no final state"):
        fields = load_json(str(text), "final_state")
        for name in ("bristle_deflections", "resume", "further"):
            fields[name] = tuple(map(float, fields[name]))
        texts = {"made_by": str(fields.pop("made_by"))}
        return State(**texts, **{name: _number(one) for name, one in fields.items()})


def _number(value: Any) -> Any:
    return value if isinstance(value, tuple) or value is None else float(value)


def taken_up(initial_state: State | xr.Dataset | None, model: Any, waveform: Any) -> State | None:
    """Return the initial state of a trajectory as a `State`; None if `initial_state` is None.

    Issues a `SimulationWarning` if the piezo has hysteresis or creep, and the new waveform differs from the
    drive of the previous trajectory before the state's time. The memory of the piezo is not part of the
    state, but computed from the complete waveform.

    Args:
        initial_state: a `State`, or a trajectory from `simulate`, which continues.
        model: the actuator or pulled slider.
        waveform: drive of the new trajectory, whose time 0 is that of the previous one.

    Raises:
        QuantityError: wrong type, or the trajectory has no final state.
    """
    if initial_state is None:
        return None
    import xarray as xr

    of_kind(initial_state, xr.Dataset | State | None, "initial_state")
    if not isinstance(initial_state, xr.Dataset):
        return initial_state
    state, piezo = final_state(initial_state), getattr(model, "piezo", None)
    if piezo is None or getattr(model, "two_port", None) is not None or "drive_voltage" not in initial_state:
        return state
    past, times = initial_state["drive_voltage"].values, initial_state["time"].values
    given = evaluate(waveform.drive(state.time), times)[0]
    off = float(np.max(np.abs(given - past)))
    if off > 1e-9 * max(float(np.max(np.abs(past))), 1.0):
        warnings.warn(
            f"until {state.time:g} s this {type(waveform).__name__} is not the drive of initial_state (by up "
            f"to {off:.3g} V): hysteresis and creep go on as it would have left them. Give both drives as "
            "one Sequence, to be continued in its time",
            SimulationWarning,
            stacklevel=3,
        )
    return state


def as_text(state: State) -> str:
    """Return the state as a JSON object with its fields; numbers are written with all digits."""
    return json.dumps(state._asdict())


def maker(of: System, drive: Drive, load: Drive, tolerance: float, until: float) -> str:
    """Return a hash, 16 hexadecimal digits, of plant, tolerance, drive and load up to the time `until` [s].

    If a continued run has the same hash, it can start from `State.resume`, and its result is that of one run
    to the last bit."""
    found = hashlib.sha256(repr((of.plant, tolerance)).encode())
    for table in (drive, load):
        n = int(np.searchsorted(table.start, until * (1.0 - SLIVER)))
        parts = (table.start[:n], table.polynomial[:n], table.harmonic[: table.first[n]])
        for part in (np.array(table.before), *parts):
            found.update(np.ascontiguousarray(part).tobytes())
    return found.hexdigest()[:16]


# Place of each part of a `State` in the plant's state: body, and offset from the body's position (or from the
# first bristle): 0 for the position, 1 for the velocity.
PARTS = {
    "stage_position": ("stage", 0),
    "stage_velocity": ("stage", 1),
    "end_effector_position": ("slider", 0),
    "end_effector_velocity": ("slider", 1),
    "bristle_deflection": ("bristle", 0),
}


def row_of(of: System, part: str) -> int | None:
    """Return the index of a part of the state (a key of `PARTS`) in the plant's array of states; None if this
    plant has no such state, or if the stage has several modes."""
    body, offset = PARTS[part]
    bristle = None if of.clamped or not of.internal else of.bodies
    first = {"stage": of.stage, "slider": of.slider, "bristle": bristle}[body]
    return first + offset if first is not None else None


def placed(state: State, of: System, contact: RelativeLoad, before: float) -> NDArray[np.float64]:
    """Return a `State` as the solver's array [states]; parts that are None have their values at rest.

    Args:
        state: the state.
        of: system of the model.
        contact: relative normal force, for the values at rest.
        before: drive for the values at rest, V (m for a pulled slider).

    Raises:
        QuantityError: a number that is not finite or a negative time; `further` or the deflections have
            another length than this model needs; a stage of several modes is given by a single position; or
            a bristle is deflected much further than sliding can deflect it.
    """
    q = contact.rest(of, before)
    if state is REST:
        return q
    for name in PARTS:
        value, row = getattr(state, name, None), row_of(of, name)
        if value is not None and row is not None:
            q[row] = value
    if state.further and len(state.further) != len(of.further):
        raise QuantityError(
            f"initial_state.further has {len(state.further)} numbers; this model has {len(of.further)}"
        )
    if state.further:
        q[of.further] = state.further
    elif len(of.stages) > 1 and (state.stage_position, state.stage_velocity) != (None, None):
        raise QuantityError(
            "initial_state: a stage of several modes is placed by `further`, the position [m] and velocity "
            "[m/s] of each, not by stage_position and stage_velocity"
        )
    if state.bristle_deflections is not None and not of.clamped:
        if len(state.bristle_deflections) != of.internal:
            raise QuantityError(
                f"initial_state has {len(state.bristle_deflections)} bristle deflections [m]; the law has "
                f"{of.internal}"
            )
        q[of.bodies : of.inner] = _within_bounds(state.bristle_deflections, of)
    if not (np.all(np.isfinite(q)) and np.isfinite(state.time) and state.time >= 0.0):
        raise QuantityError(f"initial_state must be of finite numbers, from 0 s or later: {state}")
    return q


def _within_bounds(deflections: tuple[float, ...], of: System) -> list[float]:
    """Return the bristle deflections [m]; those beyond their bound by more than rounding are moved to it.

    Raises:
        QuantityError: a deflection exceeds its bound by more than the factor `FARTHEST`.
    """
    placed, law = list(deflections), of.contact.law if of.contact is not None else None
    for i, z in enumerate(deflections if law is not None else ()):
        most = abs(project(element(law, i), z)) if np.isfinite(z) else np.inf
        if abs(z) > FARTHEST * most:
            raise QuantityError(
                f"initial_state.bristle_deflections[{i}] = {z:g} m is beyond what sliding deflects it to in "
                f"{type(law).__name__}: at most {most:g} m"
            )
        if abs(z) > ROUNDED * most:
            placed[i] = float(np.copysign(most, z))
    return placed
