"""PyMeasure's drivers of a 33500 generator and a DSOX1102G oscilloscope move what listens at two ports."""

import json
import sys
import time

import numpy as np
from pymeasure.instruments.agilent import Agilent33500
from pymeasure.instruments.keysight import KeysightDSOX1102G

where = [f"TCPIP::127.0.0.1::{port}::SOCKET" for port in sys.argv[1:3]]
ends = {"visa_library": "@py", "read_termination": "\n", "write_termination": "\n"}
generator = Agilent33500(where[0], **ends)
scope = KeysightDSOX1102G(where[1], **ends)
said = {"generator": generator.id, "oscilloscope": scope.id}
channel = generator.ch_1
# two steps of a sawtooth of 4 V, and a rest
table = np.concatenate([np.linspace(0.0, 1.0, 200), np.linspace(0.0, 1.0, 200), np.zeros(100)])
channel.data_volatile_clear()
channel.data_arb("saw", np.round(32767 * table).astype(int).tolist(), data_format="DAC")
channel.arb_file = "saw"
channel.shape = "ARB"
channel.arb_srate = 10e3
channel.amplitude, channel.offset = 8.0, 0.0
channel.burst_mode, channel.burst_ncycles, channel.burst_state = "TRIG", 1, True
said["rate"] = channel.arb_srate
scope.ch2.range = 8.0
scope.ch1.range = 16.0
said["range"] = scope.ch2.range if isinstance(scope.ch2.range, float) else scope.ask(":channel2:range?")
scope.timebase_range, scope.timebase_offset = 0.05, 0.025
scope.single()
scope.ask("*OPC?")  # it waits for the trigger, now
channel.output = True
generator.trigger()
time.sleep(0.06)
while int(scope.ask(":OPERegister:CONDition?")) & 8:
    time.sleep(0.02)
volts, preamble = scope.download_data("channel1", 5000)
sensor, _ = scope.download_data("channel2", 5000)
said["points"], said["tick"], said["begin"] = len(volts), preamble["xincrement"], preamble["xorigin"]
said["volts"] = [float(np.min(volts)), float(np.max(volts))]
said["walked"] = float(sensor[-1] - sensor[0])  # V of the sensor
channel.output = False
said["errors"] = [str(one) for one in generator.check_errors()]
generator.write("NONSENSE")
said["error"] = str(generator.check_errors())
print(json.dumps(said, default=str))
