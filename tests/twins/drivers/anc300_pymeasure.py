"""PyMeasure's driver of the ANC300 moves what listens at a port, and says how it went, as JSON."""

import json
import sys

from pymeasure.instruments.attocube import ANC300Controller

said = {}
where = f"TCPIP::127.0.0.1::{sys.argv[1]}::SOCKET"
controller = ANC300Controller(
    where, axisnames=["x", "y"], passwd="123456", query_delay=0.02, visa_library="@py", timeout=10_000
)
said["version"] = controller.version
x = controller.x
x.voltage, x.frequency = 80, 200
said["set"] = [x.voltage, x.frequency]
x.move(40)
x.mode = "stp"
x.move_raw(-10)
said["output"] = x.output_voltage
x.stop()
x.mode = "off"
x.offset_voltage = 50
said["offset"] = [x.offset_voltage, x.output_voltage]
said["capacity"] = x.measure_capacity()
x.mode = "gnd"
try:
    x.move_raw(5)
except ValueError as error:
    said["error"] = str(error)
said["mode"] = x.mode
controller.adapter.close()
print(json.dumps(said))
