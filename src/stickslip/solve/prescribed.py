"""The elements of a friction law under a prescribed motion: scalar equations, one element at a time.

Between two samples the velocity is constant, so nothing couples the elements, and neither inertia nor a
spring makes them stiff: an explicit pair of order 3(2) with error control [bogacki1989] does, at a tenth of
the cost of the solver for actuators, to compile as well as to run.
"""

from __future__ import annotations

from .._jit import compiled, kernel
from ..friction import element as element_of
from ..friction import elements, project, rate

# Steps within one interval between samples, after which the law counts as one that cannot be followed.
_MOST_STEPS = 100_000


@compiled
def advance(one, v, z, duration, tolerance):
    """The deflection after `duration` at the velocity v, and whether it could be followed to there."""
    left, h = duration, duration
    k_1 = rate(one, v, z)[1]
    for _ in range(_MOST_STEPS):
        h = min(h, left)
        k_2 = rate(one, v, z + 0.5 * h * k_1)[1]
        k_3 = rate(one, v, z + 0.75 * h * k_2)[1]
        new = z + h * (2.0 * k_1 + 3.0 * k_2 + 4.0 * k_3) / 9.0
        k_4 = rate(one, v, new)[1]
        error = abs(h * (-5.0 * k_1 + 6.0 * k_2 + 8.0 * k_3 - 9.0 * k_4) / 72.0)
        if error <= tolerance:
            z = project(one, new)
            left -= h
            if left <= 1e-12 * duration:
                return z, True
            k_1 = rate(one, v, z)[1]
        h *= min(5.0, max(0.2, 0.9 * (tolerance / max(error, 1e-300)) ** (1.0 / 3.0)))
    return z, False


@kernel
def follow(law, time, position, load, z, tolerance, samples):
    """The force of a law at each sample of a motion.

    Args:
        law: friction law record.
        time, position: [n], s and m; linear in between.
        load: [n], normal force over the reference.
        z: [elements, at least 1] at the first sample; moved to the last one. Of a static law, the direction.
        tolerance: m, on each deflection over each step.
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
        if n_elements == 0 and v != 0.0:
            z[0] = 1.0 if v > 0.0 else -1.0
        force = 0.0
        for e in range(max(n_elements, 1)):
            one = element_of(law, e)
            if n_elements > 0 and k > 0:
                z[e], reached = advance(one, v, z[e], duration, tolerance)
                if not reached:
                    return k
            force += rate(one, v, z[e])[0]
            samples[k, 1 + e] = z[e]
        samples[k, 0] = load[k] * force
    return time.size
