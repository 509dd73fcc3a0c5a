"""The elements of a friction law under a prescribed motion: scalar equations, one element at a time.

Between two samples the velocity is constant, so nothing couples the elements, and neither inertia nor a
spring makes them stiff: an explicit pair of order 3(2) with error control [bogacki1989] does, at a tenth of
the cost of the solver for actuators, to compile as well as to run.
"""

from __future__ import annotations

import math

from .._jit import compiled, kernel
from ..friction import breakaway, elements, project, rate
from ..friction import element as element_of
from ..friction import force as force_of

# Steps within one interval between samples, after which the law counts as one that cannot be followed.
_MOST_STEPS = 100_000


@compiled
def renewed(one, v, z, normal, growth):
    """Rate of the deflection where the normal force `normal` grows by `growth` [1/s]: what is newly loaded
    carries no tangential force (see `plant.system`)."""
    dz = rate(one, v, z)[1]
    if growth > 0.0 and normal > 0.0:
        return dz - growth / normal * z
    return 0.5 * dz if growth > 0.0 else dz  # the limit at contact that begins: z = t dz/2


@compiled
def advance(one, v, z, duration, tolerance, before, after):
    """The deflection after `duration` at the velocity v, and whether it could be followed to there; the
    normal force over its reference goes from `before` to `after`."""
    left, h, growth = duration, duration, (after - before) / duration
    k_1, n = renewed(one, v, z, before, growth), before
    for _ in range(_MOST_STEPS):
        h = min(h, left)
        k_2 = renewed(one, v, z + 0.5 * h * k_1, n + 0.5 * h * growth, growth)
        k_3 = renewed(one, v, z + 0.75 * h * k_2, n + 0.75 * h * growth, growth)
        new = z + h * (2.0 * k_1 + 3.0 * k_2 + 4.0 * k_3) / 9.0
        k_4 = renewed(one, v, new, n + h * growth, growth)
        # Of a bristle that relaxes x times within the step the estimate of the pair is x^2 (x - 1)/48, which
        # is blind at 1; the distance from the midpoint rule, x^2/6, is not.
        error = abs(h * (-5.0 * k_1 + 6.0 * k_2 + 8.0 * k_3 - 9.0 * k_4) / 72.0)
        error = max(error, abs(new - z - h * k_2) / 8.0)
        if error <= tolerance:
            z = project(one, new)
            left -= h
            n += h * growth
            if left <= 1e-12 * duration:
                return (z if after > 0.0 else 0.0), True
            k_1 = renewed(one, v, z, n, growth)
        h *= min(5.0, max(0.2, 0.9 * (tolerance / max(error, 1e-300)) ** (1.0 / 3.0)))
    return z, False


@compiled
def static_force(law, v, carried, before, after):
    """Force of a static law over an interval, and what it carries at its end, over its breakaway; both forces
    over the normal force, which goes from `before` to `after`. At rest the force stays what it was when the
    motion stopped, as far as rest can hold it, and follows the normal force as that of a bristle does."""
    limit = breakaway(law)
    if v != 0.0:
        force = rate(law, v, math.copysign(1.0, v))[0]
        carried = min(max(force / limit, -1.0), 1.0) if limit > 0.0 else 0.0
    else:
        if after > before:
            carried *= before / after
        force = limit * carried
    return force, (carried if after > 0.0 else 0.0)  # contact that is lost is made anew with nothing


@kernel
def follow_position(law, time, position, load, z, tolerance, proportional, samples):
    """The force of a law at each sample of a motion.

    Args:
        law: friction law record.
        time, position: [n], s and m; linear in between.
        load: [n], normal force over the reference, linear in between; 0 or more.
        z: [elements, at least 1] at the first sample; moved to the last one. Of a static law, the force that
            it carries over its breakaway.
        tolerance: m, on each deflection over each step.
        proportional: whether the deflections stay when the normal force changes, instead of being renewed.
        samples: [n, 1 + elements, at least 2], out: force (N) and state; at a sample, the force of the
            interval that ends there.

    Returns:
        Number of samples reached: n, or fewer where the law could not be followed.
    """
    n_elements = elements(law)
    for k in range(time.size):
        ahead = max(k, 1)  # the first sample shows the force with which the first interval begins
        duration = time[ahead] - time[ahead - 1]
        v = (position[ahead] - position[ahead - 1]) / duration
        before, after = (1.0, 1.0) if proportional else (load[ahead - 1], load[ahead])
        force = 0.0
        if n_elements == 0:
            then = after if k > 0 else before  # the first sample is before the interval
            force, z[0] = static_force(element_of(law, 0), v, z[0], before, then)
            samples[k, 1] = z[0]
        for e in range(n_elements):
            one = element_of(law, e)
            if k > 0:
                z[e], reached = advance(one, v, z[e], duration, tolerance, before, after)
                if not reached:
                    return k
            force += rate(one, v, z[e])[0]
            samples[k, 1 + e] = z[e]
        samples[k, 0] = load[k] * force
    return time.size


@kernel
def forces_at(law, velocity, states, force):
    """Out: the `force` [n] of a law at each sample, by its own velocity [n] and states [n, elements]. That of
    the interval before is by a velocity half an interval late, which a fit takes for other damping."""
    for k in range(velocity.size):
        force[k] = force_of(law, velocity[k], states[k])
