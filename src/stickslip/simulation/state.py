"""The state of a trajectory: where one begins, and where it has come to."""

from __future__ import annotations

import hashlib
import json
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..plant.system import state_size
from ..units import QuantityError
from .models import Contact, System


class State(NamedTuple):
    """The state of an actuator or a pulled slider at a time, SI; what is None is as at rest.

    `time` [s] is that of the drive. `error_estimate` [m]: how far the end-effector may be off by now.
    `resume` and `made_by` are the solver's, with which a trajectory goes on as if it had never ended.
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


def final_state(trajectory: xr.Dataset) -> State:
    """The state at the end of a trajectory, to be given to `simulate` as `initial_state`.

    Raises:
        QuantityError: the data are not of `simulate`, or were not followed to the end.
    """
    text = trajectory.attrs.get("final_state")
    if text is None:
        raise QuantityError(
            "there is no final state: attrs['final_state'] is written by simulate, of a complete trajectory"
        )
    fields = json.loads(text)
    for name in ("bristle_deflections", "resume"):
        fields[name] = tuple(fields[name])
    return State(**fields)


def as_text(state: State) -> str:
    """JSON, in which numbers keep every bit."""
    return json.dumps(state._asdict())


def maker(*inputs: Any) -> str:
    """A mark of what a trajectory was made with."""
    return hashlib.sha256(repr(inputs).encode()).hexdigest()[:16]


_PARTS = (
    ("stage_position", 0, "stage"),
    ("stage_velocity", 1, "stage"),
    ("end_effector_position", 0, "slider"),
    ("end_effector_velocity", 1, "slider"),
)


def placed(state: State, of: System, contact: Contact, before: float) -> NDArray[np.float64]:
    """As the solver takes it; `before`, the drive that it rests under where it does not say.

    Raises:
        QuantityError: a number that is not finite, or another number of bristles than the law has.
    """
    q = contact.rest(of, before)
    for name, offset, body in _PARTS:
        value, first = getattr(state, name), of.stage if body == "stage" else of.slider
        if value is not None and first is not None:
            q[first + offset] = value
    inner = slice(2 * len(of.plant.modes), state_size(of.plant))
    if state.bristle_deflections is not None and of.plant.elements:
        if len(state.bristle_deflections) != of.internal:
            raise QuantityError(
                f"initial_state has {len(state.bristle_deflections)} bristle deflections [m]; the law has "
                f"{of.internal}"
            )
        q[inner] = state.bristle_deflections
    if not (np.all(np.isfinite(q)) and np.isfinite(state.time) and state.time >= 0.0):
        raise QuantityError(f"initial_state must be of finite numbers, from 0 s or later: {state}")
    return q
