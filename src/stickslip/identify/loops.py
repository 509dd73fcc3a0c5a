r"""Friction loops: a friction law identified from the force that it answers to a prescribed motion.

The channel of the force need not show the friction itself. What can be identified with the law:

.. math:: F_{meas} = b + F + h F^2, \qquad F = F_{law} \left( 1 + c\,(t - t_0) \right)

bias b [N] and curvature h [1/N] of the channel (a fixture or sensor that is stiffer one way makes loops that
differ with the direction of motion, which no odd friction law does), and drift c [1/s] of the contact's
strength, as in running-in. Each is 0 unless it is free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..estimate.fit import fit_least_squares
from ..estimate.parameter import Parameter, Values
from ..estimate.problem import Residuals
from ..estimate.result import Fit
from ..estimate.search import Progress
from ..simulation import SimulationError, friction_response
from ..simulation.varied import free_names, with_values
from .channels import channel, names_of, recordings_of
from .free import Bounds, check_names, parameter

OBSERVED = "friction_force"
# Of the channel and of time, not of the law; the widest that a fit may take them.
CHANNEL = {"bias": "N", "curvature": "1/N", "drift": "1/s"}
# Relative; the response to it is far above the error of a simulation at 1e-9 m.
DIFFERENCE_STEP = 1e-3


def identify_loops(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    model: Any,
    free: Sequence[str],
    *,
    reference_normal_force: float | None = None,
    bounds: Bounds | None = None,
    noise: float | None = None,
    starts: int = 1,
    seed: int = 0,
    tolerance: float = 1e-9,
    correlated: bool = True,
    max_evaluations: int = 3000,
    progress: Callable[[Progress], None] | None = None,
) -> Fit:
    """Fit a friction law to friction loops: position prescribed, force measured.

    Every recording is one free-running prediction from its first sample, where all elements of the law are
    taken as equally deflected, so that they carry the measured force (their true state is not known).

    Args:
        recordings: with position [m] and friction_force [N], positive when the driving body moves towards +x.
        model: law record; its values are the start, and its forces hold at `reference_normal_force`.
        free: what to fit: scalar fields of the law, elements ("stiffness_2"), "stiction_ratio" and
            "breakaway_share" (see `identify_friction`), and "bias", "curvature" and "drift" (see above).
        reference_normal_force: N; the recordings then have normal_force [N], and the law's forces follow it
            in proportion. Left out, the normal force is taken as constant.
        bounds: of free parameters, in SI or as strings, else a factor 30 either side of the start; of the
            channel's: the largest force, half its inverse, and the inverse of the length in time.
        noise: standard deviation of the force, N; left out, it is estimated from the residuals.
        starts, seed, max_evaluations, progress: as `identify_friction`.
        tolerance: m, on the deflections.
        correlated: allow for residuals correlated in time in the uncertainty: here they are model error.

    Returns:
        A fit whose `model` is the law with the values put in, and whose ``predict(recording)`` is the force
        that the channel shows, free-running from the first sample.

    Raises:
        RecordingError: a channel is missing, too short or constant.
        QuantityError: a name that cannot be free, or bounds that do not fit.
        FitError: see `fit_least_squares`.
    """
    found = recordings_of(recordings)
    names = names_of(found)
    bounds = bounds or {}
    check_names(free, [*free_names(model), *CHANNEL], bounds)
    measured = [channel(r, OBSERVED, name, varies=True) for r, name in zip(found, names, strict=True)]
    origin = float(found[0]["time"].values[0])
    settings = (reference_normal_force, origin, tolerance)
    responses = [_response(r, name, *settings) for r, name in zip(found, names, strict=True)]
    largest = max(float(np.max(np.abs(force))) for force in measured)
    span = max(float(r["time"].values[-1]) for r in found) - origin
    reach = {"bias": largest, "curvature": 0.5 / largest, "drift": 1.0 / span}

    def residuals(response: Callable[..., Any], force: NDArray[np.float64]) -> Any:
        def of(values: Values) -> NDArray[np.float64]:
            return response(model, values) - force

        return of

    fit = fit_least_squares(
        [
            Residuals(residuals(response, force), force, noise, name, "N")
            for response, force, name in zip(responses, measured, names, strict=True)
        ],
        [
            _of_channel(name, reach[name], bounds) if name in CHANNEL else parameter(model, name, bounds)
            for name in free
        ],
        noise_known=noise is not None,
        correlated=correlated,
        starts=starts,
        seed=seed,
        difference_step=DIFFERENCE_STEP,
        tolerance=1e-7,
        max_evaluations=max_evaluations,
        progress=progress,
    )

    def predict(recording: xr.Dataset) -> NDArray[np.float64]:
        return _response(recording, names_of([recording])[0], *settings)(model, fit.values)

    return replace(fit, model=with_values(model, _own(fit.values)), observed=OBSERVED, predict=predict)


def _own(values: Values) -> Values:
    return {name: value for name, value in values.items() if name not in CHANNEL}


def _of_channel(name: str, reach: float, bounds: Bounds) -> Parameter:
    low, high = (float(limit) for limit in bounds.get(name, (-reach, reach)))
    return Parameter(name, min(max(0.0, low), high), low, high, CHANNEL[name], log=False)


def _response(
    recording: xr.Dataset, name: str, reference: float | None, origin: float, tolerance: float
) -> Callable[[Any, Values], NDArray[np.float64]]:
    """From a law and values to what the force channel shows."""
    time = recording["time"].values
    position = channel(recording, "position", name, varies=True)
    first = float(channel(recording, OBSERVED, name)[0])
    normal = None if reference is None else channel(recording, "normal_force", name)

    def response(model: Any, values: Values) -> NDArray[np.float64]:
        bias, curvature = values.get("bias", 0.0), values.get("curvature", 0.0)
        strength = 1.0 + values.get("drift", 0.0) * (time - origin)
        try:
            found = friction_response(
                with_values(model, _own(values)),
                time,
                position,
                normal_force=normal,
                reference_normal_force=reference or 1.0,
                proportional=True,  # a measured one, with noise
                initial_force=_unbent(first - bias, curvature) / strength[0],
                tolerance=tolerance,
            )
        except SimulationError as error:  # to a fit, a trial point without a model
            raise ArithmeticError(str(error)) from error
        force = strength * found[OBSERVED].values
        return bias + force + curvature * force**2

    return response


def _unbent(shown: float, curvature: float) -> float:
    """The force F that the channel shows as F + h F^2."""
    return 2.0 * shown / (1.0 + math.sqrt(max(0.0, 1.0 + 4.0 * curvature * shown)))
