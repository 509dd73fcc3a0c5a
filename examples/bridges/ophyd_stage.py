"""A stick-slip stage as a device of ophyd-async, which Bluesky plans scan: python ophyd_stage.py HOST:PORT.

Any positioner of stickslip will do; here it is an MCS2, or the twin of one. The stage is set to a count of
steps from where it was connected; its reading is what the positioner knows, m by a sensor, else steps.
"""

import asyncio
import json
import sys

import bluesky.plans as plans
from bluesky import RunEngine
from ophyd_async.core import AsyncStatus, StandardReadable, init_devices, soft_signal_r_and_setter
from ophyd_async.core import StandardReadableFormat as Format

from stickslip.rig.devices.smaract import Mcs2Client
from stickslip.rig.positioner import wait


class StickSlipStage(StandardReadable):
    """An axis that is moved by steps of one amplitude and rate."""

    def __init__(self, positioner, axis, voltage, frequency, name=""):
        self._positioner, self._axis, self._steps = positioner, axis, (voltage, frequency)
        self._count = 0
        with self.add_children_as_readables(Format.HINTED_SIGNAL):
            unit = "m" if positioner.ranges.sensor else "steps"
            self.position, self._set_position = soft_signal_r_and_setter(float, units=unit)
            self.steps, self._set_steps = soft_signal_r_and_setter(int)
        super().__init__(name=name)

    @AsyncStatus.wrap
    async def set(self, value):
        """To so many steps from where it was connected; done when it is still."""
        target = round(value)
        await asyncio.to_thread(self._positioner.step, self._axis, target - self._count, *self._steps)
        await asyncio.to_thread(wait, self._positioner, self._axis)
        self._count = target
        self._set_steps(target)
        self._set_position(await asyncio.to_thread(self._positioner.position, self._axis))

    async def stop(self, success=True):
        """End the motion."""
        await asyncio.to_thread(self._positioner.stop)


if __name__ == "__main__":
    host, _, port = sys.argv[1].rpartition(":")
    positioner = Mcs2Client(host, port=int(port), timeout=30.0)
    engine, rows = RunEngine({}), []
    with init_devices():
        stage = StickSlipStage(positioner, 0, "80 V", "100 Hz", name="stage")
    engine.subscribe(lambda name, document: rows.append(document["data"]) if name == "event" else None)
    engine(plans.scan([stage], stage, 0, 20, 5))
    positioner.close()
    print(json.dumps({"rows": rows}))
