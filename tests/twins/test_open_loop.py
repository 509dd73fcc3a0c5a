"""Calibration of a KIM101 by a camera: its client, its frames, its twin, with irregular steps."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from typer.testing import CliRunner

import stickslip as ss
from stickslip.cli import app
from stickslip.control import Bursts, DeadReckoning, StepLaw, fit_steps, measure_steps
from stickslip.quantities.units import to_si
from stickslip.rig import About, Irregularity
from stickslip.rig.devices.thorlabs import Kim101Client
from stickslip.rig.devices.thorlabs.twin import Kim101
from stickslip.rig.positioner import wait
from stickslip.rig.twins import make_twin

from .serving import TestClock, served

KANG = ss.load_actuator("kang2007")


def test_a_kim101_counts_and_is_calibrated_by_a_camera() -> None:
    clock = TestClock()
    twin = make_twin("kim101", KANG, irregularity=Irregularity(), seed=5, clock=clock)
    assert isinstance(twin, Kim101)
    stage = twin.channels[0].axis.stage
    with served(twin) as port:
        client = Kim101Client("127.0.0.1", port=port)

        def camera() -> float:
            clock.sleep(1.0)
            client.position(1)
            return stage.position

        bursts = Bursts((90.0, 110.0), steps=10, bursts=2, repeats=3, settle=0.0)
        law = fit_steps(measure_steps(_Waiting(client, clock), 1, camera, bursts, noise=20e-9))
        axis = DeadReckoning(_Waiting(client, clock), 1, law, camera(), 20e-9)
        axis.step(30)
        axis.step(-20)
        clock.sleep(1.0)
        low, high = axis.interval(0.999)
        assert low < camera() < high
        assert axis.tally == (30, 20, 1)
        other = _Waiting(client, clock)
        other.step(1, 5, "100 V", "100 Hz")  # by another program
        wait(other, 1)
        axis.step(1)
        assert "+5 steps by others" in axis.doubt
        client.close()


class _Waiting:
    """A client on a clock of its own, which goes on as far as steps take."""

    about: ClassVar[About] = Kim101Client.about

    def __init__(self, client: Kim101Client, clock: TestClock) -> None:
        self.client, self.clock, self.ranges = client, clock, client.ranges

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        self.client.step(axis, count, voltage, frequency)
        self.clock.sleep(abs(count) / to_si(frequency, "Hz", "frequency") + 0.1)

    def moving(self, axis: int) -> bool:
        self.clock.sleep(0.05)
        return self.client.moving(axis)

    def position(self, axis: int) -> float:
        return self.client.position(axis)

    def scan(self, axis: int, voltage: float | str) -> None:
        self.client.scan(axis, voltage)

    def stop(self) -> None:
        self.client.stop()

    def close(self) -> None:
        self.client.close()


def test_the_command_calibrates_a_controller_by_its_sensor(tmp_path: Path) -> None:
    twin = make_twin("mcs2", KANG, irregularity=Irregularity(), seed=5)
    with served(twin) as port:
        (tmp_path / "steps.yaml").write_text(
            f"positioner: {{kind: mcs2, options: {{host: 127.0.0.1, port: {port}}}}}\n"
            "bursts: {voltages: [55 V, 85 V], frequency: 200 Hz, steps: 5, bursts: 2, repeats: 2,\n"
            "         settle: 0.05 s}\n"
            "noise: 5 nm\n"
        )
        done = CliRunner().invoke(
            app, ["steps", str(tmp_path / "steps.yaml"), "--out", str(tmp_path / "out")]
        )
    assert done.exit_code == 0, done.output
    law = StepLaw.load(tmp_path / "out" / "steps.json")
    assert law.forward[1] > law.forward[0] > 0.0
    assert law.forward[1] > 1.1 * law.backward[1]  # 1.28 in slips
    assert law.frequency == 200.0
    assert (tmp_path / "out" / "steps.csv").read_text().startswith("step_m,")
