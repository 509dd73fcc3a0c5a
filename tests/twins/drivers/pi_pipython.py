"""PI's own pipython moves what listens at two ports, a piezo and a stick-slip controller; how, as JSON."""

import json
import sys
import time

from pipython import GCSDevice, GCSError
from pipython.pidevice.interfaces.pisocket import PISocket

said = {}
piezo = GCSDevice(gateway=PISocket("127.0.0.1", int(sys.argv[1])))
said["model"] = piezo.qIDN().split(",")[1].strip()
said["axes"] = piezo.axes
piezo.SVO("1", False)
said["servo"] = piezo.qSVO("1")["1"]
# two steps of a sawtooth of 60 V, recorded
points = [60.0 * i / 200 for i in range(200)] * 2 + [0.0]
piezo.WAV_PNT(1, 1, len(points), "X", points)
piezo.WSL(1, 1)
piezo.WGC(1, 1)
piezo.WTR(0, 1, 0)
piezo.RTR(1)
piezo.DRC([1, 2], ["1", "1"], [2, 16])
piezo.WGO(1, 1)
while piezo.qDRL(1)[1] < len(points):
    time.sleep(0.02)
header = piezo.qDRR([1, 2], 1, len(points))
while piezo.bufstate is not True:
    time.sleep(0.02)
said["sample_time"], (position, volts) = header["SAMPLE_TIME"], piezo.bufdata
said["samples"], said["volts"] = len(position), [min(volts), max(volts)]
said["walked"] = position[-1] - position[0]
piezo.WGO(1, 0)
for voltage in (20.0, 0.0):
    piezo.SVA("1", voltage)
    time.sleep(0.02)
    said[f"at_{voltage:g}"] = piezo.qPOS("1")["1"]
try:
    piezo.SVA("1", 500.0)
except GCSError as error:
    said["error"] = error.val

stepper = GCSDevice(gateway=PISocket("127.0.0.1", int(sys.argv[2])))
said["stepper"] = stepper.qIDN().split(",")[1].strip()
before = stepper.qPOS("1")["1"]
stepper.SVO("1", False)
stepper.OVL("1", 200.0)
stepper.OSM("1", 20)
while stepper.IsMoving("1")["1"]:
    time.sleep(0.02)
said["stepped"] = stepper.qPOS("1")["1"] - before  # mm
stepper.SVO("1", True)
stepper.MOV("1", 0.05)
while stepper.IsMoving("1")["1"]:
    time.sleep(0.02)
said["at"] = stepper.qPOS("1")["1"]
try:
    stepper.StopAll()
except GCSError as error:
    said["stopped"] = error.val
print(json.dumps(said))
