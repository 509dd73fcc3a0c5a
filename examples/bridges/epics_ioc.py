"""A stick-slip stage as an EPICS IOC with the fields of a motor, by caproto:
python epics_ioc.py HOST:PORT PREFIX

PREFIX.VAL is a count of steps from where the IOC began, .RBV what the positioner knows (m by a sensor, else
steps), .DMOV 0 while it moves, .STOP ends it. What
the positioner refuses is the answer to the write.
"""

import asyncio
import sys

from caproto.server import PVGroup, pvproperty, run

from stickslip.rig.devices.smaract import Mcs2Client


class Motor(PVGroup):
    """One axis of a positioner."""

    target = pvproperty(value=0, name=".VAL", doc="target, steps")
    readback = pvproperty(value=0.0, name=".RBV", read_only=True, precision=9, doc="position")
    done = pvproperty(value=1, name=".DMOV", read_only=True, doc="1: still")
    stop = pvproperty(value=0, name=".STOP", doc="1: stop")

    def __init__(self, positioner, axis, voltage, frequency, prefix):
        super().__init__(prefix=prefix)
        self._positioner, self._axis, self._steps = positioner, axis, (voltage, frequency)
        # The positioner answers one command after the other; what it said before a step is not told after it.
        self._one_at_a_time = asyncio.Lock()

    @target.putter
    async def target(self, instance, value):
        async with self._one_at_a_time:
            await asyncio.to_thread(
                self._positioner.step, self._axis, int(value) - instance.value, *self._steps
            )
            await self.done.write(0)
        return int(value)

    @stop.putter
    async def stop(self, instance, value):
        if value:
            async with self._one_at_a_time:
                await asyncio.to_thread(self._positioner.stop)
        return 0

    @readback.startup
    async def readback(self, instance, async_lib):
        while True:
            async with self._one_at_a_time:
                moving = await asyncio.to_thread(self._positioner.moving, self._axis)
                await instance.write(await asyncio.to_thread(self._positioner.position, self._axis))
                await self.done.write(int(not moving))
            await async_lib.sleep(0.05)


if __name__ == "__main__":
    host, _, port = sys.argv[1].rpartition(":")
    made = Motor(Mcs2Client(host, port=int(port), timeout=30.0), 0, "80 V", "100 Hz", sys.argv[2])
    run(made.pvdb, interfaces=["127.0.0.1"], log_pv_names=True)
