"""Ensembles on a GPU: ``python -m benchmarks.gpu PART [PART...]``, each result a line of JSON.

P3 (see `benchmarks.problems`) by the GPU's engine and by the processors of the same machine; by JAX on the
same GPU (part `jax`); and ensembles of random actuators of all laws (`laws`), which must end where those of
the processors end. `python -m benchmarks.gpu expected` makes these on any machine, in
`out/benchmarks/gpu.npz`; P3's truth lies beside it, made by
``python -m benchmarks.peers.lanes truth out/benchmarks/members.npy``.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any

import numpy as np

import stickslip as ss

from . import problems, random_actuators
from .ours.ensemble import ensemble as p3
from .truth import TRUTH, judge_members

EXPECTED = TRUTH.with_name("gpu.npz")
TOLERANCES = (1e-7, 1e-8, 1e-9)
MEMBERS = (4096, 65_536, 1_048_576)
ON_PROCESSORS = 65_536
ACTUATORS, VARIANTS, SEED = 18, 128, 0
LEAST, MOST = 3, 7  # runs of each row
SECONDS = 2.0  # of each row, about
RUNGE_KUTTA = {25.0: (4096, 65_536, 1_048_576), 10.0: (4096, 65_536)}  # us: members
DIFFRAX = 65_536


def varied(member: random_actuators.Member) -> dict[str, np.ndarray]:
    """Masses and drives around those of a random actuator, [VARIANTS] each."""
    rng = np.random.default_rng([SEED, member.number])
    mass, scale = np.exp(rng.uniform(np.log(0.5), np.log(2.0), (2, VARIANTS)))
    return {"end_effector_mass": member.actuator.end_effector_mass * mass, "drive_scale": scale}


def ensemble(member: random_actuators.Member, engine: Any) -> np.ndarray:
    """Net displacements, steps, and status of its variants, [3, VARIANTS]."""
    end = random_actuators.PERIODS / member.frequency
    wide = member.actuator.replace(min_voltage=-1e6, max_voltage=1e6)
    found = ss.simulate_ensemble(
        wide, member.waveform, end, parameters=varied(member), load=member.load, engine=engine
    )
    return np.array([found["net_displacement"], found["steps"], found["status"]], dtype=float)


def expect() -> None:
    """The random actuators on the processors."""
    found = [ensemble(m, "cpu") for m in random_actuators.members(ACTUATORS, SEED)]
    np.savez(EXPECTED, found=np.array(found))


def timed(run: Callable[[], np.ndarray]) -> tuple[np.ndarray, list[float]]:
    """Its result, and how long it takes [s] after a first call that compiles."""
    result, walls = run(), []
    while len(walls) < LEAST or (sum(walls) < SECONDS and len(walls) < MOST):
        start = time.perf_counter()
        result = run()
        walls.append(time.perf_counter() - start)
    return result, walls


def row(tool: str, setting: str, run: Callable[[], np.ndarray]) -> dict[str, Any]:
    """A line of the table: errors of the first 4096 members, whose truth is known."""
    try:
        net, walls = timed(run)
    except Exception as reason:  # the others go on
        return {"tool": tool, "setting": setting, "failed": f"{type(reason).__name__}: {reason}"[:500]}
    return {
        "tool": tool,
        "setting": setting,
        **judge_members(net[: problems.MEMBERS]),
        "members": net.size,
        "per_s": net.size / statistics.median(walls),
        "wall_s": walls,
    }


def rows() -> Iterator[dict[str, Any]]:
    """P3 by each tool."""
    for tolerance in TOLERANCES:
        for members in MEMBERS:
            yield row("stickslip, GPU", f"{tolerance:g} m", p3(members, tolerance, "cuda"))
        yield row("stickslip, processors", f"{tolerance:g} m", p3(ON_PROCESSORS, tolerance, "cpu"))


def of_jax() -> Iterator[dict[str, Any]]:
    """P3 by JAX and diffrax on the GPU, in the equations of `benchmarks.peers.jax`."""
    import jax  # pyright: ignore[reportMissingImports]
    import jax.numpy as jnp  # pyright: ignore[reportMissingImports]

    from .peers.jax import _adaptive, _member

    def on_gpu(member: Callable[[Any], Any], members: int) -> Callable[[], np.ndarray]:
        sets = jnp.asarray(problems.parameter_sets(members))
        compiled = jax.jit(jax.vmap(member)).lower(sets).compile()
        return lambda: np.asarray(jax.block_until_ready(compiled(sets)))

    for step, sizes in RUNGE_KUTTA.items():
        for members in sizes:
            run = on_gpu(lambda p, step=step: _member(step, p), members)
            yield row("JAX vmap, RK4, GPU", f"{step:g} us", run)
    yield row("diffrax vmap, Tsit5, GPU", "rtol 1e-05", on_gpu(lambda p: _adaptive(1e-5, p), DIFFRAX))


def agreement() -> Iterator[dict[str, Any]]:
    """The random actuators on the GPU, against those of the processors."""
    expected = np.load(EXPECTED)["found"]
    for m, cpu in zip(random_actuators.members(ACTUATORS, SEED), expected, strict=True):
        start = time.perf_counter()
        gpu = ensemble(m, "cuda")
        both = (gpu[2] == 0) & (cpu[2] == 0)
        yield {
            "law": m.law,
            "waveform": type(m.waveform).__name__,
            "same_status": int(np.sum(gpu[2] == cpu[2])),
            "complete": int(np.sum(both)),
            "same_steps": int(np.sum(gpu[1] == cpu[1])),
            "furthest_apart_m": float(np.max(np.abs(gpu[0] - cpu[0])[both], initial=0.0)),
            "wall_s": time.perf_counter() - start,
        }


PARTS: dict[str, Callable[[], Iterator[dict[str, Any]]]] = {"P3": rows, "jax": of_jax, "laws": agreement}


def machine() -> dict[str, Any]:
    """What this runs on."""
    command = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
    packages = ("stickslip", "nvidia-cuda-nvrtc-cu12", "numpy", "jax", "diffrax")
    return {
        "gpu": subprocess.run(command, capture_output=True, text=True).stdout.strip(),
        "processors": os.cpu_count(),
        "versions": {package: version(package) for package in packages},
    }


if __name__ == "__main__":
    if sys.argv[1:] == ["expected"]:
        expect()
    else:
        print(json.dumps(machine()))
        for name in sys.argv[1:] or PARTS:
            for found in PARTS[name]():
                print(json.dumps(found), flush=True)
