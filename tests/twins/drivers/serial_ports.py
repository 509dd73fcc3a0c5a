"""Our clients move what listens on two serial ports, a KIM101 and an ANC300; pylablib's driver the second.

pylablib's driver of the KIM101 first raises RTS, which a pseudo terminal does not have.
"""

import json
import sys

from pylablib.devices.Attocube import ANC300

from stickslip.rig.devices.attocube import Anc300Client
from stickslip.rig.devices.thorlabs import Kim101Client
from stickslip.rig.positioner import wait

kim101, anc300 = sys.argv[1:]
said = {}
ours = Kim101Client(kim101, timeout=10)
ours.step(2, 30, "110 V", "200 Hz")
wait(ours, 2)
said["kim101"] = ours.position(2)
ours.stop()
ours.close()

controller = ANC300(anc300, backend="serial")
said["axes"] = controller.get_all_axes()
controller.set_mode(1, "stp")
controller.set_voltage(1, 80)
controller.set_frequency(1, 200)
controller.move_by(1, 30)
controller.wait_move(1)
said["voltage"] = controller.get_voltage(1)
controller.set_mode(1, "gnd")
controller.close()
ours = Anc300Client(anc300, port=None, timeout=10)
ours.step(1, -10, "80 V", "200 Hz")
wait(ours, 1)
said["anc300"] = ours.position(1)
ours.stop()
ours.close()
print(json.dumps(said))
