"""The library nidaqmx above a driver of ours, with the plant behind it: recordings, a stop and errors.

Walks of a campaign go to the folder that is given, and what was put out for them.

Everything of the library but the calls into NI's driver runs as it is.
"""

import json
import sys
from contextlib import ExitStack
from pathlib import Path

import nidaqmx.utils
import numpy as np
from nidaqmx._base_interpreter import BaseInterpreter
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqError

import stickslip as ss
from stickslip.recording.calibration import fit_calibration
from stickslip.rig import RigError
from stickslip.rig.devices.national_instruments import DaqmxRig
from stickslip.rig.twins import Stage
from stickslip.rig.twins.stage import Piece
from stickslip.rig.variation import EXACT

GAIN, PER_VOLT = 15.0, 1e-5  # V/V of the amplifier, m/V of the sensor
UNPLUGGED = -88705


class Driver(BaseInterpreter):
    """What nidaqmx calls of NI's driver, for one card."""

    def __init__(self, stage):
        self.stage, self.tasks, self.last = stage, {}, 0
        self.zero = stage.position
        self.card = 0.0  # V at the output
        self.ramp = None
        self.noise, self.random = 0.0, np.random.default_rng(2)  # m, of the sensor
        self.gone = False  # the cable is out

    def task(self, handle):
        return self.tasks[handle]

    def create_task(self, name):
        self.last += 1
        self.tasks[self.last] = {"kind": "", "channels": []}
        return self.last, True

    def clear_task(self, task):
        del self.tasks[task]

    def hash_task_handle(self, handle):
        return hash(handle)

    def get_task_attribute_string(self, task, attribute):
        return {0x1273: ", ".join(self.task(task)["channels"]), 0x1276: f"task {task}"}.get(attribute, "")

    def get_read_attribute_string(self, task, attribute):
        return ", ".join(self.task(task)["channels"])

    def get_write_attribute_string(self, task, attribute):
        return ", ".join(self.task(task)["channels"])

    def create_ai_voltage_chan(self, task, physical_channel, *given):
        self.add(task, "in", physical_channel)

    def create_ao_voltage_chan(self, task, physical_channel, *given):
        self.add(task, "out", physical_channel)

    def add(self, task, kind, channel):
        if not channel.startswith("Dev1/"):
            raise DaqError("Device identifier is invalid.", DAQmxErrors.INVALID_DEVICE_ID)
        self.task(task)["kind"] = kind
        self.task(task)["channels"].append(channel)

    def internal_get_last_created_chan(self):
        raise NotImplementedError

    def get_chan_attribute_int32(self, task, channel, attribute):
        return {"in": 10100, "out": 10102}[self.task(task)["kind"]] if attribute == 0x187F else 10322

    def cfg_samp_clk_timing(self, task, rate, source, active_edge, sample_mode, samps_per_chan):
        self.task(task).update(rate=rate, source=source, count=samps_per_chan)

    def write_analog_f64(self, task, count, auto_start, timeout, layout, data):
        self.task(task)["data"] = np.array(data).ravel()
        return count

    def start_task(self, task):
        one = self.task(task)
        if one["kind"] == "out" and one["source"]:
            self.waiting = one
        elif one["kind"] == "out":
            self.ramp = one["data"]
            self.play(one["data"], one["rate"], one["data"].size)
        else:
            one["samples"] = self.play(self.waiting["data"], one["rate"], one["count"]) / PER_VOLT
            one["given"] = 0

    def play(self, data, rate, count):
        """Each value is held; the position at each sample, just as its value comes."""
        tick, values = 1.0 / rate, np.append(data, np.full(max(count - data.size, 0), data[-1]))[:count]
        begins = np.arange(count) * tick
        times = np.stack([begins + 0.02 * tick, begins + tick], axis=1).ravel()
        path = self.stage.play(Piece(times, GAIN * np.repeat(values, 2), begins[1:]))
        self.card = float(values[-1])
        noise = self.noise * self.random.standard_normal(count)
        return np.interp(begins, path.times, path.end_effector) - self.zero + noise

    def get_read_attribute_uint32(self, task, attribute):
        if attribute == 0x1223:  # samples that wait to be read
            one = self.task(task)
            return min(1000, one["count"] - one["given"])
        return len(self.task(task)["channels"])

    def read_analog_f64(self, task, count, timeout, fill, array):
        if self.gone:
            raise DaqError("Device does not exist or is not accessible.", UNPLUGGED)
        one = self.task(task)
        array[:] = one["samples"][one["given"] : one["given"] + count]
        one["given"] += count
        return array, count

    def get_device_attribute_string(self, device, attribute):
        return {0x631: "USB-6363 (simulated)"}[attribute]

    def get_device_attribute_uint32(self, device, attribute):
        return {0x632: 0x1A2B3C4}[attribute]

    def get_system_info_attribute_uint32(self, attribute):
        return {0x1272: 23, 0x1923: 8, 0x2F22: 0}[attribute]

    def get_write_attribute_uint64(self, task, attribute):
        if self.gone:
            raise DaqError("Device does not exist or is not accessible.", UNPLUGGED)
        return self.task(task)["data"].size

    def get_write_attribute_uint32(self, task, attribute):
        return len(self.task(task)["channels"])

    def wait_until_task_done(self, task, timeout):
        pass

    def stop_task(self, task):
        pass


Driver.__abstractmethods__ = frozenset()
hidden = ss.load_actuator("kang2007").replace(stage_reaction=False)
driver = Driver(Stage(hidden, variation=EXACT.variation, seed=2))
nidaqmx.utils._select_interpreter = lambda *given, **named: driver

armed = ExitStack()  # to the end of this program
armed.enter_context(ss.rig.armed("a simulated card"))
rig = DaqmxRig("Dev1", gain=GAIN, inputs={"gauge": "ai0"}, rate="10 kHz")
gauge = fit_calibration(
    np.array([-10.0, 0.0, 10.0]),
    PER_VOLT * np.array([-10.0, 0.0, 10.0]),
    1,
    name="gauge",
    x_unit="V",
    y_unit="m",
)
channels = {
    "drive_voltage": ss.rig.Channel("drive"),
    "end_effector_position": ss.rig.Channel("gauge", (gauge,), zero=True),
}
capture = ss.rig.Capture(length="0.16 s", interval="100 us")
drive = ss.Sawtooth("65 V", "20 Hz", periods=3)
recording = ss.rig.measure(rig, drive, channels, capture, ss.rig.Limits(max_voltage="100 V"))
truth = ss.simulate(hidden, drive, times=recording.time.values[1:])
said = {
    "samples": recording.sizes["time"],
    "off": float(
        np.abs(recording.end_effector_position.values[1:] - truth.end_effector_position.values).max()
    ),
    "walked": float(recording.end_effector_position.values[-1]),
    "volts": float(recording.drive_voltage.max()),
    "ramp": driver.ramp.tolist()[-1:],
    "left": len(driver.tasks),
    "device": json.loads(recording.attrs["device"]),
}
driver.noise, folder, limits = 5e-9, Path(sys.argv[1]), ss.rig.Limits(max_voltage="100 V")
for volts in (65, 80):
    walk = ss.rig.measure(rig, ss.Sawtooth(float(volts), "20 Hz", periods=3), channels, capture, limits)
    ss.save_recording(walk, folder / f"walk_{volts}.nc")
    np.save(folder / f"output_{volts}.npy", rig.output())


def pulled(doing, part):
    """The cable comes out in the middle of a run."""
    driver.gone = part > 0.4


try:
    ss.rig.measure(rig, drive, channels, capture, limits, progress=pulled)
except RigError as error:
    said["pulled"] = [str(error), *error.__notes__]
    said["kept"] = error.recording.sizes["time"]
driver.gone = False
ss.rig.interlock_of(rig).acknowledge("a test", "the cable is in again")
said["left_then"] = len(driver.tasks)
for what, call in {
    "no_device": lambda: ss.rig.measure(
        DaqmxRig("Dev7", gain=GAIN, inputs={"gauge": "ai0"}), drive, channels, capture, ss.rig.Limits()
    ),
    "too_high": lambda: rig.load(np.full(9, 200.0)),
    "limit": lambda: ss.rig.measure(
        rig, ss.Step("120 V"), channels, capture, ss.rig.Limits(max_voltage="100 V")
    ),
}.items():
    try:
        call()
    except RigError as error:
        said[what] = str(error)
rig.close()
print(json.dumps(said))
