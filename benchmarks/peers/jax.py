"""diffrax on JAX, compiled, 64 bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from .. import problems
from ..problems import DAMPING, DRIVE, PERIOD, PERIODS, PROBLEMS, SLOPE, STIFFNESS, TAU
from ..truth import judge_members
from ..worker import Case, serve

jax.config.update("jax_enable_x64", True)


def rates(t: Any, q: Any, p: problems.Contact) -> tuple[Any, ...]:
    """Of (y, w, z, x, s)."""
    y, w, z, _, s = q
    v = w - s
    g = p.coulomb_force
    if p.stiction_force is not p.coulomb_force:  # both may be traced
        g = g + (p.stiction_force - p.coulomb_force) * jnp.exp(-((v / p.stribeck_velocity) ** 2))
    dz = v - p.sigma_0 * jnp.abs(v) / g * z
    return (
        w,
        DRIVE * SLOPE * t - DAMPING * w - STIFFNESS * y,
        dz,
        s,
        (p.sigma_0 * z + p.sigma_1 * dz) / p.mass,
    )


def with_diffrax(problem: str, method: str, tolerance: float) -> Callable[[], np.ndarray]:
    p = PROBLEMS[problem]
    term = diffrax.ODETerm(lambda t, q, _: jnp.stack(rates(t, tuple(q), p)))
    solver = getattr(diffrax, method)()
    control = diffrax.PIDController(rtol=tolerance, atol=tolerance * jnp.array(p.scale))
    save = diffrax.SaveAt(ts=jnp.asarray(TAU))

    def one_period(state: Any, _: Any) -> tuple[Any, Any]:
        found = diffrax.diffeqsolve(
            term, solver, 0.0, PERIOD, None, state, saveat=save, stepsize_controller=control, max_steps=None
        )
        return found.ys[-1], found.ys[1:, 3]

    @jax.jit
    def simulate(state: Any) -> Any:
        _, positions = jax.lax.scan(one_period, state, None, length=PERIODS)
        return jnp.concatenate([jnp.zeros(1), positions.reshape(-1)])

    return lambda: np.asarray(jax.block_until_ready(simulate(jnp.zeros(5))))


def trajectory() -> Iterator[Case]:
    chosen = {
        "P1": {"Tsit5": (1e-5, 1e-6, 1e-7), "Dopri8": (1e-5, 1e-7)},
        "P2": {"Tsit5": (1e-5,), "Kvaerno5": (1e-5,)},
    }
    for problem, methods in chosen.items():
        for method, tolerances in methods.items():
            for tolerance in tolerances:
                yield Case(
                    "diffrax",
                    method,
                    f"rtol {tolerance:g}",
                    problem,
                    partial(with_diffrax, problem, method, tolerance),
                    partial(problems.error, problem),
                )


def _member(step: float, p: Any) -> Any:
    """Net displacement of one parameter set by the classical Runge-Kutta method; the step in us."""
    contact = PROBLEMS["P1"]._replace(sigma_0=p[0], coulomb_force=p[1], stiction_force=p[1], mass=p[2])
    steps = round(PERIOD / (step * 1e-6))
    h = PERIOD / steps

    def moved(q: Any, a: float, k: Any) -> Any:
        return tuple(x + a * dx for x, dx in zip(q, k, strict=True))

    def advance(q: Any, i: Any) -> tuple[Any, None]:
        t = i * h
        k1 = rates(t, q, contact)
        k2 = rates(t + h / 2, moved(q, h / 2, k1), contact)
        k3 = rates(t + h / 2, moved(q, h / 2, k2), contact)
        k4 = rates(t + h, moved(q, h, k3), contact)
        slopes = zip(k1, k2, k3, k4, strict=True)
        return moved(q, h / 6, tuple(a + 2 * b + 2 * c + d for a, b, c, d in slopes)), None

    def period(q: Any, _: Any) -> tuple[Any, None]:
        return jax.lax.scan(advance, q, jnp.arange(steps))[0], None

    return jax.lax.scan(period, tuple(jnp.zeros(()) for _ in range(5)), None, length=PERIODS)[0][3]


def _sharded(member: Callable[[Any], Any]) -> Callable[[], np.ndarray]:
    """All parameter sets of P3, split over the devices that XLA_FLAGS makes of the cores."""
    mesh = Mesh(np.array(jax.devices()), ("members",))
    over = PartitionSpec("members")
    run = jax.jit(jax.shard_map(jax.vmap(member), mesh=mesh, in_specs=over, out_specs=over, check_vma=False))
    sets = jax.device_put(jnp.asarray(problems.parameter_sets()), NamedSharding(mesh, over))
    compiled = run.lower(sets).compile()
    return lambda: np.asarray(jax.block_until_ready(compiled(sets)))


def _adaptive(tolerance: float, p: Any) -> Any:
    """Net displacement of one parameter set by diffrax."""
    contact = PROBLEMS["P1"]._replace(sigma_0=p[0], coulomb_force=p[1], stiction_force=p[1], mass=p[2])
    term = diffrax.ODETerm(lambda t, q, _: jnp.stack(rates(t, tuple(q), contact)))
    control = diffrax.PIDController(rtol=tolerance, atol=tolerance * jnp.array(contact.scale))

    def period(q: Any, _: Any) -> tuple[Any, None]:
        found = diffrax.diffeqsolve(
            term, diffrax.Tsit5(), 0.0, PERIOD, None, q, stepsize_controller=control, max_steps=None
        )
        return found.ys[-1], None

    return jax.lax.scan(period, jnp.zeros(5), None, length=PERIODS)[0][3]


def members() -> Iterator[Case]:
    for step in (25.0, 10.0):
        make = partial(_sharded, partial(_member, step))
        yield Case("JAX vmap", "RK4", f"{step:g} us", "P3", make, judge_members)
    make = partial(_sharded, partial(_adaptive, 1e-5))
    yield Case("diffrax vmap", "Tsit5", "rtol 1e-05", "P3", make, judge_members, once=True)


if __name__ == "__main__":
    serve({"trajectory": trajectory, "ensemble": members}, ["diffrax", "jax"])
