"""Terms that a model of a walk may lack (such as viscous friction): the parameters of each term, and small
changes of the model that show the effect of the term."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...estimate.parameter import Values
from ...estimate.result import Fit
from ...friction import elements
from ...physics.actuator import Actuator
from ...simulation.varied import NORMAL, ratios_of, value_of
from ..step.fit import STAGE_PARAMETERS
from .walks import Walks

VISCOUS = "viscous friction"
STRIBECK = "stiction that falls with the velocity (a Stribeck curve)"
DIRECTION = "friction that differs forward and backward"
CONSTANT = "a constant force along x (a slope, a spring, a cable)"
SLOPE = "friction that changes along the stroke"
RIPPLE = "friction that comes and goes along the stroke"
REACTION = "friction that acts back on the stage"
NO_REACTION = "a stage so stiff that friction does not move it"
STAGE = "a stage with other values than the given ones"

# Stribeck velocities, relative to the model's, at which a Stribeck curve is tried.
STRIBECK_VELOCITIES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
# Numbers of waves of a ripple over the walked range that are tried: multiples of WAVES_STEP up to MOST_WAVES.
WAVES_STEP, MOST_WAVES = 0.5, 8.0
# Upper bound of the viscous friction force at the fastest motion, relative to the Coulomb force of the
# contact.
MOST_VISCOUS = 30.0
# Largest change of the normal force, relative to the normal force: over the walked range, by a ripple, or
# between the two directions.
MOST_CHANGE = 0.9

Array = NDArray[np.float64]


class Way(NamedTuple):
    """One variant of a missing term, such as a Stribeck curve with one Stribeck velocity.

    Attributes:
        beside: for each perturbed model the changed values by name, SI; each model has a small step in one
            parameter of the term.
        start: function that returns the initial guess by name, SI. It takes the estimated change of each
            parameter as a multiple of its small step, shape (perturbed models,).
    """

    beside: tuple[Values, ...]
    start: Callable[[Array], Values]


class Term(NamedTuple):
    """A term that the model may lack.

    Attributes:
        cause: the term in words.
        names: names of the parameters that the term frees.
        ways: variants of the term, of which the most promising one is fitted.
        bounds: bounds by name, SI. If empty, those of a ripple are set about the initial guess, others by
            default.
        untied: names of parameters whose ties the term removes.
    """

    cause: str
    names: tuple[str, ...]
    ways: tuple[Way, ...]
    bounds: Mapping[str, tuple[float, float]] = MappingProxyType({})
    untied: tuple[str, ...] = ()


class Scales(NamedTuple):
    """Typical sizes of walks: friction `force` of the contact [N], largest `speed` of the end-effector [m/s],
    and `way`, the range of its positions in all walks [m]; in N m, rad/s and rad for a rotary actuator."""

    force: float
    speed: float
    way: float


def scales_of(fit: Fit, walks: Walks) -> Scales:
    """Return the typical sizes of walks, from the positions simulated by the fit and from the Coulomb force
    (or summed strengths) of its law; for another law the force is mass times largest acceleration."""
    model, law = fit.model, fit.model.friction
    found = [r + x for r, x in zip(fit.residuals, walks.measured, strict=True)]
    speeds = [np.gradient(x, motion.time) for x, motion in zip(found, walks.motions, strict=True)]
    forces = [np.gradient(v, motion.time) for v, motion in zip(speeds, walks.motions, strict=True)]
    force = model.end_effector_mass * max(float(np.max(np.abs(a))) for a in forces)
    force = getattr(law, "coulomb_force", sum(getattr(law, "strength", ())) or force)
    return Scales(
        float(force),
        max(float(np.max(np.abs(v))) for v in speeds),
        float(np.ptp(np.concatenate(found))),
    )


def terms_of(fit: Fit, walks: Walks, step: float) -> list[Term]:
    """Return the terms that can be added to the model of a fit, without those whose parameters are free,
    fixed or tied in the fit already.

    Args:
        fit: result of `identify_friction`, with its model.
        walks: recordings of the fit.
        step: size of the small steps of parameters, relative to typical sizes.
    """
    model, size = fit.model, scales_of(fit, walks)
    taken = {p.name for p in (*fit.parameters, *fit.beside)}
    bristles = elements(model.friction) > 0
    made = [_viscous(model, size, step), _stribeck(model, fit, step)]
    made += [_direction(model, step)] if bristles else []
    made += [_constant(model, size, step), _slope(model, size, step), _ripple(model, size, step)]
    if walks.stage is None and not model.static:
        made.append(_stage(model, step, taken))
    return [one for one in made if one is not None and one.names and not taken & {*one.names}]


def _linear(name: str, now: float, size: float, limits: tuple[float, float]) -> Way:
    """Return the variant of a term that changes only the parameter `name`: from its present value `now`, by a
    small step `size`, within `limits` (lower, upper), all in SI."""
    low, high = limits
    return Way(({name: now + size},), lambda steps: {name: float(np.clip(now + steps[0] * size, low, high))})


def _viscous(model: Actuator, size: Scales, step: float) -> Term | None:
    if "sigma_2" not in model.friction._fields or not size.speed > 0.0:
        return None
    typical = size.force / size.speed
    limits = (0.0, _round(MOST_VISCOUS * typical + 10.0 * model.friction.sigma_2))
    way = _linear("sigma_2", model.friction.sigma_2, step * typical, limits)
    return Term(VISCOUS, ("sigma_2",), (way,), {"sigma_2": limits})


def _stribeck(model: Actuator, fit: Fit, step: float) -> Term | None:
    law = model.friction
    if "stiction_ratio" not in ratios_of(law) or "stribeck_velocity" not in law._fields:
        return None
    ratio, velocity = value_of(model, "stiction_ratio"), law.stribeck_velocity
    free = {p.name for p in fit.parameters}
    if free & {"stiction_ratio", "stiction_force"}:
        grown = {"stribeck_velocity": (1.0 + step) * velocity}
        names = tuple({"stribeck_velocity"} - free)
        return Term(STRIBECK, names, (Way((grown,), lambda _: {"stribeck_velocity": velocity}),))

    def way(velocity: float) -> Way:
        def start(steps: Array) -> Values:
            found = float(np.clip(ratio + steps[0] * step, 1.0 + 1e-3, 2.5))
            return {"stiction_ratio": found, "stribeck_velocity": velocity}

        beside = {"stiction_ratio": ratio + step, "stribeck_velocity": velocity}
        return Way((beside,), start)

    # If stiction equals Coulomb friction, the model's Stribeck velocity has no effect and may be far from the
    # true one, so several are tried.
    shares = STRIBECK_VELOCITIES if abs(ratio - 1.0) < 1e-9 else (1.0,)
    ways = tuple(way(share * velocity) for share in shares)
    return Term(STRIBECK, ("stiction_ratio", "stribeck_velocity"), ways, {}, ("stiction_force",))


def _direction(model: Actuator, step: float) -> Term:
    name, limits = f"{NORMAL}asymmetry", (-MOST_CHANGE, MOST_CHANGE)
    return Term(DIRECTION, (name,), (_linear(name, value_of(model, name), step, limits),), {name: limits})


def _constant(model: Actuator, size: Scales, step: float) -> Term:
    limits = (-_round(size.force), _round(size.force))
    way = _linear("external_force", model.external_force, step * size.force, limits)
    return Term(CONSTANT, ("external_force",), (way,), {"external_force": limits})


def _slope(model: Actuator, size: Scales, step: float) -> Term | None:
    name = f"{NORMAL}slope"
    if not size.way > 0.0:
        return None
    limits = (-_round(MOST_CHANGE / size.way), _round(MOST_CHANGE / size.way))
    way = _linear(name, value_of(model, name), step / size.way, limits)
    return Term(SLOPE, (name,), (way,), {name: limits})


def _ripple(model: Actuator, size: Scales, step: float) -> Term | None:
    along = model.normal_force
    if not size.way > 0.0 or (along is not None and along.ripple > 0.0):
        return None
    ripple, wavelength, phase = (f"{NORMAL}{field}" for field in ("ripple", "wavelength", "phase"))

    def way(waves: float) -> Way:
        length = size.way / waves
        sides = tuple({ripple: step, wavelength: length, phase: at} for at in (0.0, 0.5 * math.pi))

        def start(steps: Array) -> Values:
            sine, cosine = steps * step
            depth = float(np.clip(math.hypot(sine, cosine), 1e-3, 0.5))
            return {ripple: depth, wavelength: length, phase: math.atan2(cosine, sine)}

        return Way(sides, start)

    count = round(MOST_WAVES / WAVES_STEP)
    return Term(RIPPLE, (ripple, wavelength, phase), tuple(way(WAVES_STEP * (i + 1)) for i in range(count)))


def _stage(model: Actuator, step: float, taken: set[str]) -> Term:
    names = tuple(n for n in STAGE_PARAMETERS if n not in taken and getattr(model, n, 0.0) > 0.0)
    now = {name: float(getattr(model, name)) for name in names}

    def start(steps: Array) -> Values:
        grown = np.clip(1.0 + step * steps, 0.5, 2.0)
        return {name: float(value * by) for (name, value), by in zip(now.items(), grown, strict=True)}

    way = Way(tuple({name: (1.0 + step) * value} for name, value in now.items()), start)
    return Term(STAGE, names, (way,))


def bounds_about(term: Term, values: Values) -> Mapping[str, tuple[float, float]]:
    """Return the bounds of a term's parameters by name, SI: for a ripple about `values` (its initial guess or
    estimates), otherwise the term's own."""
    if term.cause != RIPPLE:
        return term.bounds
    ripple, wavelength, phase = (values[name] for name in term.names)
    around = ((0.0, min(MOST_CHANGE, _round(2.0 * ripple))), (0.7 * wavelength, 1.3 * wavelength))
    limits = (*around, (phase - math.pi, phase + math.pi))
    rounded = [(_round(low), _round(high)) for low, high in limits]
    return dict(zip(term.names, rounded, strict=True))


def _round(value: float) -> float:
    return float(f"{value:.3g}")
