"""The thesis's channels and a bench without noise, for the tests of rigs."""

from __future__ import annotations

from dataclasses import replace

from stickslip.physics.actuator import load_actuator
from stickslip.physics.electronics import Filter, Interferometer, PositionSensor
from stickslip.recording.calibration import load_calibration
from stickslip.rig import Bench, Channel, load_bench

BENCH = load_bench("kang2007-bench")
ACTUATOR = load_actuator("kang2007").replace(stage_reaction=False)
INDUCTIVE = tuple(load_calibration(f"kang2007-{name}") for name in ("inductive-5", "recalibration"))
CHANNELS = {
    "drive_voltage": Channel("drive"),
    "piezo_elongation": Channel("strain_gauge", (load_calibration("kang2007-strain-gauge"),)),
    "end_effector_position": Channel("inductive", INDUCTIVE, Filter(2, 2e3), zero=True),
}
IDEAL = {"drive_voltage": Channel("drive"), "end_effector_position": Channel("ideal")}


def quiet(bench: Bench = BENCH) -> Bench:
    """The bench with sensors that neither hiss nor drift."""
    sensors = {}
    for name, mounted in bench.sensors.items():
        sensor = mounted.sensor
        if isinstance(sensor, Interferometer):
            sensor = sensor._replace(noise_density=0.0)
        elif not isinstance(sensor, PositionSensor):
            sensor = sensor._replace(noise_density=0.0, drift=0.0)
        sensors[name] = replace(mounted, sensor=sensor)
    return bench.replace(sensors=sensors)
