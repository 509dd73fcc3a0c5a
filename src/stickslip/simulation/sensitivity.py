"""Derivatives of a trajectory, and of the steady step, by the parameters and the initial state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..actuator import Actuator
from ..mechanism import FIRST_BRISTLE, SLIDER, SLIDER_VELOCITY, STAGE, STAGE_VELOCITY
from ..records import did_you_mean, quantities
from ..solve.motion import one_bristle
from ..solve.neighbours import neighbours
from ..solve.outcome import DONE
from ..solve.periods import LOG_ROWS, integrate_near
from ..units import QuantityError, to_si
from ..waveform.drive import Drive
from ..waveform.signal import Waveform
from .errors import SimulationError
from .models import checked_drive, load_drive, mechanism, resting_state
from .steady import periodic_drive, steady_orbit
from .trajectory import sample_times
from .varied import changed_fields, free_names, law_of

# Relative, and absolute where a value is zero. The steps are the same, so only rounding limits it.
DIFFERENCE = 1e-6
# The initial state: row, unit, and a difference that is small against what moves.
INITIAL = {
    "initial_stage_position": (STAGE, "m", 1e-12),
    "initial_stage_velocity": (STAGE_VELOCITY, "m/s", 1e-9),
    "initial_end_effector_position": (SLIDER, "m", 1e-12),
    "initial_end_effector_velocity": (SLIDER_VELOCITY, "m/s", 1e-9),
    "initial_bristle_deflection": (FIRST_BRISTLE, "m", 1e-13),
}


class Moved(NamedTuple):
    """A model, the neighbours of it that differ in one value each, and by how much."""

    model: Actuator
    laws: NDArray[np.float64]
    mechs: NDArray[np.float64]
    states: NDArray[np.float64]
    steps: NDArray[np.float64]


def moved(model: Actuator, names: Sequence[str], state: NDArray[np.float64], before: float | None) -> Moved:
    """Neighbours of a model in the state given; with `before`, each rests under that drive by itself.

    Raises:
        QuantityError: a name that is not known, or a law with other than one internal state.
    """
    mech = mechanism(model)
    if not one_bristle(model.friction, mech):
        raise QuantityError(
            f"derivatives are for an actuator with a law of one internal state and a stage that moves; "
            f"{type(model.friction).__name__} on this one is not: difference `simulate` instead"
        )
    known = [*free_names(model), *INITIAL]
    laws, mechs, states, steps = [], [], [], []
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known)
            raise QuantityError(f"no derivative by {name!r}{hint}: there are {', '.join(known)}")
        law, body, own = model.friction, mech, state.copy()
        if name in INITIAL:
            row, _, step = INITIAL[name]
            own[row] += step
        else:
            value = _value(model, name)
            step = DIFFERENCE * (abs(value) or 1.0)
            # Unchecked, for it may step over a bound of its field by a millionth.
            fields, changed = changed_fields(model, {name: value + step})
            law = tuple.__new__(type(law), fields.values())
            if changed:
                body = mechanism(tuple.__new__(Actuator, (model._asdict() | changed).values()))
        if before is not None and name not in INITIAL:
            own = resting_state(law, body, before)
        laws.append([float(v) for v in law])
        mechs.append([float(v) for v in body])
        states.append(own)
        steps.append(step)
    n = len(names)  # of none, the tables have their columns all the same
    return Moved(
        model,
        np.array(laws).reshape(n, len(model.friction)),
        np.array(mechs).reshape(n, len(mech)),
        np.array(states).reshape(n, state.size),
        np.array(steps),
    )


def follow_moved(
    of: Moved,
    drive: Drive,
    load: Drive,
    state: NDArray[np.float64],
    times: NDArray[np.float64],
    tolerance: float,
    max_steps: int = 20_000_000,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Samples as of `adaptive.integrate`, derivatives of the position [times, names], and those of the last
    state [5, names]; `state` becomes the last state.

    Raises:
        SimulationError: the motion could not be followed to the end.
    """
    model, mech = of.model, mechanism(of.model)
    samples = np.full((times.size, 6), np.nan)
    near = neighbours(of.laws, of.mechs, of.states.copy(), LOG_ROWS, times.size)
    span = np.array([0.0, times[-1]])
    outcome, reached, _, _ = integrate_near(
        model.friction, mech, drive, load, state, span, tolerance, max_steps, times, samples, near
    )
    if outcome != DONE:
        raise SimulationError(f"the motion could not be followed beyond t = {reached:.6g} s")
    by = (near.positions - samples[:, SLIDER]).T / of.steps
    return samples, by, (near.states - state).T / of.steps


def sensitivities(
    model: Actuator,
    waveform: Waveform,
    duration: float | str | None = None,
    *,
    parameters: Sequence[str],
    sample_rate: float | str = 1e3,
    times: ArrayLike | None = None,
    tolerance: float | str = 1e-9,
    load: Waveform | float = 1.0,
) -> xr.Dataset:
    """The end-effector's position and its derivatives by parameters and initial state.

    Each derivative is the difference to a neighbour that takes the steps of the trajectory itself (see
    `solve.neighbours`): it costs less than a simulation, and has no noise of an error control in it.

    Args:
        model: an actuator whose law has one internal state.
        parameters: names of fields of the law and of the actuator, "stiction_ratio", "breakaway_share", and
            "initial_stage_position", "initial_stage_velocity", "initial_end_effector_position",
            "initial_end_effector_velocity", "initial_bristle_deflection".
        waveform, duration, sample_rate, times, tolerance, load: as for `simulate`.

    Returns:
        Dataset over "time" (s) and "parameter" of end_effector_position (m) and derivative, in m per unit of
        the parameter, whose unit is the coordinate "unit".

    Raises:
        QuantityError: an unknown name, a law with other than one internal state, or see `simulate`.
        SimulationError: the motion could not be followed to the end.
    """
    wanted = sample_times(waveform, duration, sample_rate, times)
    end = float(wanted[-1])
    drive = checked_drive(model, waveform, end, periodic=False)
    state = resting_state(model.friction, mechanism(model), drive.before)
    of = moved(model, parameters, state, drive.before)
    tolerance = to_si(tolerance, "m", "tolerance")
    samples, by, _ = follow_moved(of, drive, load_drive(load, end), state, wanted, tolerance)
    return xr.Dataset(
        {
            "end_effector_position": (
                "time",
                samples[:, SLIDER],
                {"units": "m", "long_name": "end-effector position"},
            ),
            "derivative": (
                ("parameter", "time"),
                by.T,
                {"units": "m per unit of the parameter", "long_name": "derivative of the position"},
            ),
        },
        coords={
            "time": ("time", wanted, {"units": "s"}),
            "parameter": list(parameters),
            "unit": ("parameter", [_unit(model, name) for name in parameters]),
        },
    )


def steady_step_derivatives(
    model: Actuator,
    waveform: Waveform,
    *,
    parameters: Sequence[str],
    tolerance: float = 1e-10,
    load: Waveform | float = 1.0,
) -> dict[str, float]:
    """Derivatives of `steady_step` by parameters, m per unit of the parameter.

    With r the periodic state and G the map of one period, the orbit moves by dr = (I - dG/dr)^-1 dG/dp, and
    the step by its own derivatives along dr and p.

    Raises:
        QuantityError, NotPeriodicError: see `steady_step` and `sensitivities`.
    """
    if set(parameters) & set(INITIAL):
        raise QuantityError("the steady step does not depend on the initial state")
    orbit = steady_orbit(model, waveform, tolerance=tolerance, load=load)
    period, drive = periodic_drive(model, waveform)
    state = orbit.state.copy()
    of = moved(model, [*parameters, *INITIAL], state, None)
    times = np.array([0.0, period])
    _, _, last = follow_moved(of, drive, load_drive(load, period), state, times, 0.1 * tolerance)
    rows = [STAGE, STAGE_VELOCITY, SLIDER_VELOCITY, FIRST_BRISTLE]
    n = len(parameters)
    by_state, by_parameter = last[:, n:], last[:, :n]
    shift = np.linalg.solve(np.eye(4) - by_state[np.ix_(rows, rows)], by_parameter[rows])
    total = by_parameter[SLIDER] + by_state[SLIDER, rows] @ shift
    return dict(zip(parameters, total.tolist(), strict=True))


def _value(model: Actuator, name: str) -> float:
    from_law = law_of(model)._asdict()
    if name in from_law:
        return float(from_law[name])
    if name == "stiction_ratio":
        return from_law["stiction_force"] / from_law["coulomb_force"]
    if name == "breakaway_share":
        return from_law["breakaway_deflection"] * from_law["sigma_0"] / from_law["coulomb_force"]
    return float(getattr(model, name))


def _unit(model: Actuator, name: str) -> str:
    if name in INITIAL:
        return INITIAL[name][1]
    known: dict[str, Any] = quantities(type(model)) | quantities(type(model.friction))
    return known[name].unit if name in known else ""
