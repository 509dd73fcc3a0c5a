"""The package beside MuJoCo and SciPy on published cases: docs/benchmarks/other-tools.md.

    python -m benchmarks.other_tools FOLDER --write      # makes FOLDER/walk.npz
    OTHER/bin/python -m benchmarks.peers.mujoco FOLDER   # environment with benchmarks/peers/mujoco.txt
    python -m benchmarks.other_tools FOLDER              # prints the tables

CPU seconds, each once after a first call that compiles nothing and loads modules. Errors are those against
`ss.simulate` at a tolerance of 1e-12 m; tests compare that with other solvers.
"""

from __future__ import annotations

import json
import math
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import stickslip as ss
from stickslip.report.figures.style import panels, svg

Array = NDArray[np.float64]

NOISE, SAMPLES = 20e-9, 401
START = {"sigma_0": 1e6, "sigma_1": 30.0, "coulomb_force": 0.6}


def pulled(tolerance: float, rate: float) -> Any:
    law = ss.LuGre(1e5, math.sqrt(1e5), 0.4, coulomb_force=1.0, stiction_force=1.5, stribeck_velocity=1e-3)
    slider = ss.physics.PulledSlider(mass=1.0, spring_stiffness=2.0, damping=0.0, friction=law)
    pull = ss.waveform.Ramp(0.1, unit="m")
    return ss.simulate(slider, pull, 30.0, sample_rate=rate, tolerance=tolerance)


def radau(rtol: float) -> Array:
    """The same by SciPy, each 2 ms."""

    def equations(t: float, y: Array) -> list[float]:
        x, v, z = y
        steady = 1.0 + 0.5 * math.exp(-((v / 1e-3) ** 2))
        rate = v - 1e5 * abs(v) * z / steady
        return [v, 2.0 * (0.1 * t - x) - (1e5 * z + math.sqrt(1e5) * rate + 0.4 * v), rate]

    times, scale = np.arange(15001) / 500.0, np.array([1.0, 0.1, 1e-5])
    return solve_ivp(equations, (0.0, 30.0), [0.0] * 3, "Radau", times, rtol=rtol, atol=0.1 * rtol * scale).y[
        0
    ]


def walked(tolerance: float) -> Any:
    actuator = ss.load_actuator("kang2007").replace(stage_reaction=False)
    return ss.simulate(actuator, ss.Sawtooth(65.0, 5.0, periods=8), 1.6, sample_rate=1e3, tolerance=tolerance)


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    call()
    begun = time.process_time()
    return call(), time.process_time() - begun


def spool(tolerance: float) -> Any:
    """16 ms of the case of the gallery, each 20 us."""
    page = (Path(__file__).parents[1] / "docs" / "gallery" / "spool-valve.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    (code,) = re.findall(r"```python\n(.*?)\nmade = ", page, re.DOTALL)
    exec(code.replace("sample_rate=1e6", f"times=2e-5 * np.arange(801), tolerance={tolerance!r}"), names)
    return names["motion"]


def write(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    exact = walked(1e-12).end_effector_position.values[:SAMPLES]
    noise = NOISE * np.random.default_rng(0).standard_normal(SAMPLES)
    np.savez(
        folder / "walk.npz",
        time=np.arange(SAMPLES) / 1e3, position=exact + noise, noise=NOISE, start=list(START.values()),
    )  # fmt: skip


def fitted(folder: Path) -> tuple[Any, float]:
    """The same recording and start by `identify_friction`, without delay, offset and noise to find."""
    given = np.load(folder / "walk.npz")
    actuator = ss.load_actuator("kang2007").replace(stage_reaction=False)
    law = actuator.friction._replace(**START, stiction_force=START["coulomb_force"])
    recording = ss.make_recording(given["time"], {"end_effector_position": given["position"]}, title="walk")
    drive = ss.Sawtooth(65.0, 5.0, periods=8)

    def fit() -> Any:
        return ss.identify_friction(
            [recording], actuator.replace(friction=law), list(START), drive=drive, noise=NOISE, hops=0,
            channel=(), diagnose=False,
        )  # fmt: skip

    return timed(fit)


def _draw(points: dict[str, list[tuple[float, float]]], path: Path) -> None:
    """Error over CPU time, one line for each tool."""
    made = panels([3.2])
    axes = made[1][0]
    for tool, found in points.items():
        axes.plot(*np.array(found).T, "o-", label=tool)
    axes.set(xscale="log", yscale="log", xlabel="CPU time (s)", ylabel="largest error of the position (m)")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    made[0].subplots_adjust(left=0.12, right=0.72, bottom=0.17, top=0.96)
    path.write_text(svg(made[0]) + "\n", encoding="utf-8")
    made[0].savefig(path.with_suffix(".png"), dpi=100)


def main(folder: Path) -> None:
    peer, numbers = np.load(folder / "mujoco.npz"), json.loads((folder / "mujoco.json").read_text("utf-8"))
    exact = pulled(1e-12, 500.0).end_effector_position.values
    points: dict[str, list[tuple[float, float]]] = {}

    def told(tool: str, setting: str, error: float, seconds: float) -> None:
        points.setdefault(tool, []).append((seconds, error))
        print(f"  {tool} {setting}: {error:.3g}, {seconds:.3g}")

    print("de Wit: setting, largest error (m), CPU (s)")
    for name in peer.files:
        if name.startswith("de_wit"):
            _, integrator, step = name.split()
            error = float(np.abs(peer[name] - exact).max())
            told(f"MuJoCo {integrator}", f"{float(step):g} s", error, numbers[name])
    for rtol in (1e-4, 1e-6, 1e-8):
        found, seconds = timed(lambda rtol=rtol: radau(rtol))
        told("SciPy Radau", f"{rtol:g}", float(np.abs(found - exact).max()), seconds)
    for tolerance in (1e-5, 1e-7, 1e-9):
        motion, seconds = timed(lambda tolerance=tolerance: pulled(tolerance, 500.0))
        error = float(np.abs(motion.end_effector_position.values - exact).max())
        told("stickslip", f"{tolerance:g} m, said {motion.attrs['error_estimate']:.3g}", error, seconds)
    _draw(points, folder / "other-tools.svg")
    exact = walked(1e-12).end_effector_position.values
    print("thesis")
    for name in peer.files:
        if name.startswith("walk"):
            print(f"  MuJoCo {name[5:]}: {np.abs(peer[name] - exact).max():.3g}, {numbers[name]:.3g}")
    for tolerance in (1e-7, 1e-9):
        motion, seconds = timed(lambda tolerance=tolerance: walked(tolerance))
        error = np.abs(motion.end_effector_position.values - exact).max()
        print(f"  stickslip {tolerance:g} m: {error:.3g}, {seconds:.3g}")
    print("spool")
    exact = spool(1e-11).end_effector_position.values
    for tolerance in (1e-7, 1e-9):
        motion, seconds = timed(lambda tolerance=tolerance: spool(tolerance))
        error = np.abs(motion.end_effector_position.values - exact).max()
        print(f"  stickslip {tolerance:g} m: {error:.3g}, {seconds:.3g}")
    for name in peer.files:
        if name.startswith("spool"):
            print(f"  MuJoCo {name[6:]}: {np.abs(peer[name] - exact).max():.3g}, {numbers[name]:.3g}")
    print("vibration: mean force 1/3 N at half of the velocity amplitude; MuJoCo", numbers["vibration"])
    fit, seconds = fitted(folder)
    print("fit:", fit.values, fit.confidence_intervals(), f"{seconds:.3g} s")
    print("sysid:", numbers["sysid"])


if __name__ == "__main__":
    target = Path(sys.argv[1])
    write(target) if "--write" in sys.argv else main(target)
