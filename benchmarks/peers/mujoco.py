"""MuJoCo on the problems of benchmarks/other_tools.py: its LuGre actuator, stops, and sysid.

    python -m benchmarks.peers.mujoco FOLDER

reads FOLDER/walk.npz (a recording to fit) and writes FOLDER/mujoco.npz and FOLDER/mujoco.json. The
environment needs benchmarks/peers/mujoco.txt and nothing of stickslip.
"""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path

import mujoco
import numpy as np

LUGRE = (
    '<dcmotor joint="x" motorconst="1e-9 1e-9" resistance="1" damping="{s2}" '
    'lugre="{s0} {s1} {fc} {fs} {vs}"/>'
)
HEAVY = 1e6  # kg, of a body whose motion is prescribed


def model(step: float, integrator: str, bodies: str, actuators: str, rest: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step!r}" gravity="0 0 0" integrator="{integrator}"/>'
        '<default><geom type="sphere" size="0.01" contype="0" conaffinity="0"/>'
        '<joint type="slide" axis="1 0 0"/></default>'
        f"<worldbody>{bodies}</worldbody><actuator>{actuators}</actuator>{rest}</mujoco>"
    )


def de_wit(step: float, integrator: str) -> tuple[np.ndarray, float]:
    """Positions each 2 ms and CPU seconds of 30 s; the pull is that of the middle of each step."""
    law = LUGRE.format(s0=1e5, s1=math.sqrt(1e5), s2=0.4, fc=1.0, fs=1.5, vs=1e-3)
    body = '<body><joint name="x" stiffness="2"/><geom mass="1"/></body>'
    m = model(step, integrator, body, f'<motor joint="x"/>{law}')
    d, every, found = mujoco.MjData(m), round(2e-3 / step), [0.0]
    begun = time.process_time()
    for i in range(round(30.0 / step)):
        d.ctrl[0] = 0.2 * (i + 0.5) * step
        mujoco.mj_step(m, d)
        if (i + 1) % every == 0:
            found.append(d.qpos[0])
    return np.array(found), time.process_time() - begun


ZETA, OMEGA, GAIN = 0.524, 3303.1, 0.1057e-6


def walk_model(step: float, s0: float, s1: float, fc: float) -> mujoco.MjModel:
    """The thesis's actuator without reaction: its stage is heavy, its end-effector moves relative to it."""
    law = LUGRE.format(s0=s0, s1=s1, s2=0.0, fc=fc, fs=fc, vs=1e-3)
    k, c = HEAVY * OMEGA**2, 2.0 * ZETA * OMEGA * HEAVY
    bodies = (
        f'<body><joint name="y" stiffness="{k!r}" damping="{c!r}"/><geom mass="{HEAVY!r}"/>'
        '<body><joint name="x"/><geom mass="0.1"/></body></body>'
    )
    drive = f'<motor name="u" joint="y" gear="{GAIN * k!r}"/>'
    rest = (
        '<tendon><fixed name="xe"><joint joint="x" coef="1"/><joint joint="y" coef="1"/></fixed></tendon>'
        '<sensor><tendonpos name="xe" tendon="xe"/></sensor>'
    )
    return model(step, "RK4", bodies, drive + law, rest)


def voltages(step: float, duration: float) -> np.ndarray:
    """Of the middle of each step: 65 V, 5 Hz."""
    return 65.0 * np.mod(5.0 * (np.arange(round(duration / step)) + 0.5) * step, 1.0)


def walk(step: float) -> tuple[np.ndarray, float]:
    """End-effector positions each ms and CPU seconds of 1.6 s."""
    m, u = walk_model(step, 1.399e6, 34.9, 0.5401), voltages(step, 1.6)
    d, every, found = mujoco.MjData(m), round(1e-3 / step), [0.0]
    begun = time.process_time()
    for i, volts in enumerate(u):
        d.ctrl[0] = volts
        mujoco.mj_step(m, d)
        if (i + 1) % every == 0:
            found.append(d.qpos[0] + d.qpos[1])
    return np.array(found), time.process_time() - begun


def spool(step: float) -> tuple[np.ndarray, float]:
    """Positions each 20 us and CPU seconds of 16 ms; the soft stops are damped for a restitution of 0.3."""
    zeta = -math.log(0.3) / math.hypot(math.pi, math.log(0.3))
    body = (
        f'<body><joint name="x" stiffness="1488.58" springref="{-8.545 / 1488.58!r}" '
        'frictionloss="1" limited="true" range="0 1.016e-3" '
        f'solreflimit="{5.0 * step!r} {zeta!r}" solimplimit="0.9999 0.9999 1e-6" '
        f'solreffriction="{2.0 * step!r} 1" solimpfriction="0.9999 0.9999 1e-6"/>'
        '<geom mass="3.3612e-4"/></body>'
    )
    m = model(step, "implicitfast", body, '<motor joint="x"/>')
    d, every, found = mujoco.MjData(m), round(2e-5 / step), [0.0]
    begun = time.process_time()
    for i in range(round(0.016 / step)):
        pressure = 6895.0 * (18.0 + 4.0 * math.sin(2.0 * math.pi * 250.0 * (i + 0.5) * step))
        d.ctrl[0] = 7.374e-5 * pressure
        mujoco.mj_step(m, d)
        if (i + 1) % every == 0:
            found.append(d.qpos[0])
    return np.array(found), time.process_time() - begun


def vibration(step: float) -> tuple[float, float]:
    """Mean friction (N) of the fourth period and CPU seconds: 1 N, 1 um at 100 Hz, v0 half of v."""
    amplitude, omega = 1e-6, 2.0 * math.pi * 100.0
    law = LUGRE.format(s0=1.0 / (0.003 * amplitude), s1=0.0, s2=0.0, fc=1.0, fs=1.0, vs=1.0)
    body = f'<body><joint name="x"/><geom mass="{HEAVY!r}"/></body>'
    m = model(step, "implicitfast", body, f'<motor joint="x"/>{law}')
    d, total = mujoco.MjData(m), 0.0
    d.qvel[0] = 1.5 * amplitude * omega
    begun, count = time.process_time(), round(0.01 / step)
    for i in range(4 * count):
        d.ctrl[0] = -HEAVY * amplitude * omega**2 * math.sin(omega * (i + 0.5) * step)
        mujoco.mj_step(m, d)
        if i >= 3 * count:
            total -= float(d.actuator_force[1])
    return total / count, time.process_time() - begun


def fitted(recording: dict[str, np.ndarray]) -> dict[str, object]:
    """sigma_0, sigma_1 and F_C by the sysid toolbox, with its intervals, for two periods of the walk."""
    from mujoco import sysid

    step, times, measured = 25e-6, recording["time"], recording["position"]
    start = recording["start"]
    u = voltages(step, float(times[-1]))
    names, scale = ("sigma_0", "sigma_1", "coulomb_force"), np.array(start)
    params = sysid.ParameterDict({name: sysid.Parameter(name, 1.0, 1.0 / 30.0, 30.0) for name in names})

    def of_values(x: np.ndarray) -> np.ndarray:
        m = walk_model(step, *(scale * x))
        d, every, found = mujoco.MjData(m), round(float(times[1] - times[0]) / step), [0.0]
        for i, volts in enumerate(u):
            d.ctrl[0] = volts
            mujoco.mj_step(m, d)
            if (i + 1) % every == 0:
                found.append(d.qpos[0] + d.qpos[1])
        return (np.array(found) - measured) / recording["noise"]

    def residual(x: np.ndarray, _: object) -> tuple[list[np.ndarray], None, None]:
        """By the compiled stepper, for one set of values or for columns of several (of differences)."""
        columns = np.reshape(x, (len(names), -1))
        made = np.stack([of_values(column) for column in columns.T], axis=1)
        return [made if np.ndim(x) == 2 else made[:, 0]], None, None

    begun = time.process_time()
    best, result = sysid.optimize(params, residual, optimizer="mujoco", verbose=False)
    seconds = time.process_time() - begun
    residuals = [of_values(best.as_vector())]
    intervals = sysid.calculate_intervals(residuals, np.asarray(result.jac))
    return {
        "values": dict(zip(names, (scale * best.as_vector()).tolist(), strict=True)),
        "intervals": [np.asarray(one).tolist() for one in intervals],
        "scale": scale.tolist(),
        "chi_squared": float(np.sum(residuals[0] ** 2)),
        "seconds": seconds,
    }


def main(folder: Path) -> None:
    arrays: dict[str, np.ndarray] = {}
    numbers: dict[str, object] = {}
    for integrator, steps in (("Euler", (2e-3, 1e-4)), ("implicitfast", (2e-3, 1e-4)), ("RK4", (2e-3, 1e-4))):
        for step in steps:
            arrays[f"de_wit {integrator} {step:g}"], numbers[f"de_wit {integrator} {step:g}"] = de_wit(
                step, integrator
            )
    for step in (1e-4, 2.5e-5):
        arrays[f"walk RK4 {step:g}"], numbers[f"walk RK4 {step:g}"] = walk(step)
    for step in (2e-6, 1e-6):
        arrays[f"spool implicitfast {step:g}"], numbers[f"spool implicitfast {step:g}"] = spool(step)
    numbers["vibration"] = vibration(1e-6)
    numbers["sysid"] = fitted(dict(np.load(folder / "walk.npz")))
    np.savez(folder / "mujoco.npz", **arrays)
    (folder / "mujoco.json").write_text(json.dumps(numbers, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
