"""Plants in slow, obvious NumPy, the docstring of `plant.system` term by term; an element without a kink."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import reference
from stickslip.friction import Coulomb, CoulombViscous, MaxwellSlip, Stribeck
from stickslip.friction.law import register
from stickslip.simulation.plant.system import Element, Plant

Array = NDArray[np.float64]
# Positions in um, velocities in mm/s, deflections in 0.1 um, of what is no contact 1.
UM, MM_S, BRISTLE = 1e-6, 1e-3, 1e-7


class Lag(NamedTuple):
    """An element that is no contact; its output is bent, so that no slope is the same everywhere."""

    rate: float
    through: float
    bend: float


def lagging(law, v, z):
    return z + law.through * v + law.bend * z * z, law.rate * (v - z)


register(Lag, lagging, smooth=True)


def states_of(law: Any) -> int:
    """Written out: nothing here asks the package what a law is."""
    if isinstance(law, MaxwellSlip):
        return len(law.stiffness)
    return 0 if isinstance(law, Coulomb | CoulombViscous | Stribeck) else 1


def law_at(law: Any, s: float, z: Array) -> tuple[float, Array]:
    if isinstance(law, Lag):
        force, dz = lagging(law, s, z[0])
        return force, np.array([dz])
    return reference.rate(law, s, z)


def one_sided(law: Any, s: float, z: Array, side: float) -> tuple[float, Array]:
    """The law on one side of v = 0, turned about its point v = 0 beyond it."""
    if isinstance(law, Lag) or s * side >= 0.0:
        return law_at(law, s, z)
    here, there = law_at(law, 0.0, z), law_at(law, -s, z)
    return 2.0 * here[0] - there[0], 2.0 * here[1] - there[1]


def entries(shares: tuple[float | None, ...] | None, length: int) -> Array:
    return np.array([share or 0.0 for share in shares or (None,) * length])


def input_of(element: Element, q: Array, u: tuple[float, ...], outputs: list[float]) -> float:
    x, w = q[0::2], q[1::2]
    s = entries(element.velocity, x.size) @ w + entries(element.position, x.size) @ x
    s += (element.drive or 0.0) * u[0] + (element.drive_rate or 0.0) * u[1]
    return s + entries(element.feed, len(outputs)) @ outputs


def load_of(element: Element, q: Array, normal: tuple[float, ...]) -> tuple[float, float]:
    """Normal force over its reference, and its rate over itself."""
    of_time, rate = (normal[0], normal[1] / normal[0]) if element.loaded is not None else (1.0, 0.0)
    p, steepness, speed = 1.0, 0.0, 0.0
    if (along := element.along) is not None:
        place = max(m for m, share in enumerate(element.push) if share is not None)
        x, speed = q[2 * place], q[2 * place + 1]
        p, steepness = (shape_along(along, x, order) for order in (0, 1))
    return element.normal * of_time * p, rate + steepness / p * speed


def shape_along(along: Any, x: float, order: int) -> float:
    """p(x), or its slope by hand."""
    wave = 2 * np.pi / along.wavelength
    if order == 0:
        return (1 + along.slope * x) ** along.power + along.ripple * np.sin(wave * x + along.phase)
    spring = along.power * along.slope * (1 + along.slope * x) ** (along.power - 1)
    return spring + wave * along.ripple * np.cos(wave * x + along.phase)


def motion(
    plant: Plant, sides: tuple[float, ...], q: Array, u: tuple[float, ...], normal: tuple[float, ...]
) -> tuple[Array, Array]:
    """dq/dt and the outputs; held contacts by the equations that they obey."""
    bodies, inside = np.split(q, [2 * len(plant.modes)])
    f, rates = [], []
    for element, side in zip(plant.elements, sides, strict=False):
        z, inside = np.split(inside, [states_of(element.law)])
        s = input_of(element, bodies, u, f)
        side = float(np.sign(side))
        n, grows = load_of(element, bodies, normal)
        if not z.size:
            force = 0.0 if side == 0.0 else one_sided(element.law, s, np.array([side]), side)[0]
        else:
            force, dz = one_sided(element.law, s, z, side)
            # The deflection itself, which falls where new contact carries nothing yet.
            power = 1.0 if element.along is None else element.along.stiffness_exponent
            d = z * n ** (1.0 - power)
            change = dz - power * max(grows, 0.0) * d
            rates += list(n ** (power - 1.0) * change + (power - 1.0) * grows * z)
        uneven = 0.0 if element.along is None else element.along.asymmetry
        f.append(n * (force + uneven * abs(force)))
    push = np.array([entries(e.push, len(plant.modes)) for e in plant.elements])
    push = push.reshape(len(plant.elements), len(plant.modes))
    free = np.array(
        [
            mode.drive * u[0] + mode.acceleration - mode.damping * w - mode.stiffness * x
            for mode, x, w in zip(plant.modes, bodies[0::2], bodies[1::2], strict=True)
        ]
    )
    acceleration, f = free + np.array(f) @ push, np.array(f)
    held = [e for e in range(len(plant.elements)) if is_held(plant, sides, e)]
    if held:
        along = np.array([entries(plant.elements[e].velocity, len(plant.modes)) for e in held])
        follows = np.array([(plant.elements[e].drive_rate or 0.0) * u[2] for e in held])
        f[held] += np.linalg.lstsq(along @ push[held].T, -(along @ acceleration + follows), rcond=1e-9)[0]
        acceleration = free + f @ push
    return np.array([*np.column_stack([bodies[1::2], acceleration]).ravel(), *rates]), f


def is_held(plant: Plant, sides: tuple[float, ...], e: int) -> bool:
    return sides[e] == 0.0 and states_of(plant.elements[e].law) == 0


def riding(plant: Plant, sides: Any, q: Array, u: Any, begun: Array, u_begun: Any) -> Array:
    """Held contacts, one after the other, put the last body that they move where it was to the others."""
    q, bodies = q.copy(), 2 * len(plant.modes)
    x, w, x_begun = q[0:bodies:2], q[1:bodies:2], begun[0:bodies:2]
    for e, element in enumerate(plant.elements):
        if is_held(plant, sides, e):
            along, push = (entries(shares, len(plant.modes)) for shares in (element.velocity, element.push))
            last = np.flatnonzero(along * push)[-1]
            follows = element.drive_rate or 0.0
            x[last] -= (along @ (x - x_begun) + follows * (u[0] - u_begun[0])) / along[last]
            w[last] -= (along @ w + follows * u[1]) / along[last]
    return q


def at_time(derivatives: tuple[float, ...], t: float) -> tuple[float, ...]:
    """Taylor's polynomial of the drive, or of the load, with its derivatives."""
    d0, d1, d2, d3 = derivatives
    return d0 + d1 * t + d2 * t**2 / 2 + d3 * t**3 / 6, d1 + d2 * t + d3 * t**2 / 2, d2 + d3 * t, d3


def scale_of(plant: Plant) -> Array:
    """What the entries of a state are in."""
    laws = [element.law for element in plant.elements]
    inside = [1.0 if isinstance(law, Lag) else BRISTLE for law in laws for _ in range(states_of(law))]
    return np.array([UM, MM_S] * len(plant.modes) + inside)


def jacobian(plant: Plant, sides: Any, q: Array, u: tuple[float, ...], normal: tuple[float, ...]) -> Array:
    """Of dq/dt by the state, by central differences."""
    made = np.empty((q.size, q.size))
    for c, step in enumerate(1e-5 * scale_of(plant)):
        one = step * np.eye(q.size)[c]
        ahead, behind = (motion(plant, sides, at, u, normal)[0] for at in (q + one, q - one))
        made[:, c] = (ahead - behind) / (2.0 * step)
    return made


def by_time(plant: Plant, sides: Any, q: Array, u: tuple[float, ...], normal: tuple[float, ...]) -> Array:
    """The partial derivative of dq/dt by time, by a central difference."""
    dt = 1e-9
    ahead, behind = (motion(plant, sides, q, at_time(u, t), at_time(normal, t))[0] for t in (dt, -dt))
    return (ahead - behind) / (2.0 * dt)


def weights_and_rates(
    plant: Plant, sides: Any, q: Array, u: tuple[float, ...], normal: tuple[float, ...]
) -> tuple[list[float], list[float]]:
    """An error of a deflection counts as what its force does to a position within 1/rate; and how fast the
    fastest state of each element relaxes."""
    weights, rates, c, J = [], [], 2 * len(plant.modes), jacobian(plant, sides, q, u, normal)
    for e, element in enumerate(plant.elements):
        push, along = (entries(shares, len(plant.modes)) for shares in (element.push, element.velocity))
        first = c
        for _ in range(states_of(element.law)):
            step = 1e-5 * scale_of(plant)[c] * np.eye(q.size)[c]
            ahead, behind = (motion(plant, sides, at, u, normal)[1][e] for at in (q + step, q - step))
            made = abs(ahead - behind) / (2.0 * step[c]) * (np.abs(push) @ np.abs(along)) / plant.rate**2
            weights.append(made if isinstance(element.law, Lag) else max(1.0, made))
            c += 1
        rates.append(max([0.0, *-np.diag(J)[first:c]]))
    return weights, rates
