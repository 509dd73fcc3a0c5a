"""Laws under a prescribed motion, for the contract tests."""

from __future__ import annotations

import math

import numpy as np

from stickslip.friction.law import element, elements, force, project, rate


def evaluate(law, v, z):
    """Force [n] and rate of each state [n, elements] at the points (v[i], z[i])."""
    forces = np.empty(v.size)
    rates = np.empty(z.shape)
    for i in range(v.size):
        forces[i] = force(law, v[i], z[i])
        for e in range(z.shape[1]):
            rates[i, e] = rate(element(law, e), v[i], z[i, e])[1]
    return forces, rates


def bounded(law, z):
    """What the law's own bounds make of the states z [n, elements]."""
    out = np.empty(z.shape)
    for i in range(z.shape[0]):
        for e in range(z.shape[1]):
            out[i, e] = project(element(law, e), z[i, e])
    return out


def response(law, v, dt, start):
    """Steps of constant velocity v[i] for dt[i], each one Runge-Kutta step of order 4 per element.

    Returns the forces at the start and at the end of each step [n] and the states [n + 1, elements]; the
    state of a static law is the direction of sliding.
    """
    n_states = max(elements(law), 1)
    z = np.empty((v.size + 1, n_states))
    z[0] = start
    first, last = np.empty(v.size), np.empty(v.size)
    for i in range(v.size):
        if elements(law) == 0:
            z[i] = math.copysign(1.0, v[i])
            z[i + 1] = z[i]
        else:
            for e in range(n_states):
                one = element(law, e)
                k1 = rate(one, v[i], z[i, e])[1]
                k2 = rate(one, v[i], z[i, e] + 0.5 * dt[i] * k1)[1]
                k3 = rate(one, v[i], z[i, e] + 0.5 * dt[i] * k2)[1]
                k4 = rate(one, v[i], z[i, e] + dt[i] * k3)[1]
                z[i + 1, e] = project(one, z[i, e] + dt[i] / 6.0 * (k1 + 2.0 * (k2 + k3) + k4))
        first[i] = force(law, v[i], z[i])
        last[i] = force(law, v[i], z[i + 1])
    return first, last, z


def at_constant_velocity(law, v, displacement, steps):
    """Force at the end of each step of a move at constant velocity from a relaxed contact, and the states.

    The steps get shorter towards the end, so that what a step leaves of the error goes to zero too.
    """
    shares = 2.0 * np.arange(steps, 0, -1) / (steps * (steps + 1))
    dt = displacement / abs(v) * shares
    _, last, z = response(law, np.full(steps, float(v)), dt, np.zeros(max(elements(law), 1)))
    return last, z
