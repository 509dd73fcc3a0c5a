"""The MCS2 driver of BLISS (ESRF) moves what listens at a port, and says how it went, as JSON.

The driver runs whole and unmodified. BLISS remembers what is initialised in a server (Beacon, Redis): here a
value of this process stands for that. Its axes, whose settings live there too, are left out.
"""

import json
import sys
import time
import warnings

warnings.simplefilter("ignore")

from bliss.controllers import motor  # noqa: E402
from bliss.controllers.motors.smaract_mcs2 import Positioner, SmarAct_MCS2, SmarActMCS2Error  # noqa: E402


class Remembered:
    """Of one process, where BLISS has all of a beamline's."""

    def __init__(self, owner, name, default_value=None):
        self.value = default_value


def until_still(of, longest=30.0):
    end = time.monotonic() + longest
    while of.status.ACTIVELY_MOVING and time.monotonic() < end:
        time.sleep(0.02)
    return not of.status.ACTIVELY_MOVING


said = {}
motor.Cache = Remembered
controller = SmarAct_MCS2({"tcp": {"url": f"127.0.0.1:{sys.argv[1]}"}})
controller.initialize()
controller.initialize_hardware()
said["channels"] = controller.nb_channels
p = Positioner(controller, 1, None)
said["at_power_on"] = [p.position, p.is_physical_position_known]
p.power_mode = "Enabled"
# steps
p.set_property(":MMOD", 4)
p.open_loop_step_frequency, p.open_loop_step_amplitude = 100, 52428  # 80 V
p.move_absolute(20)
said["still"] = until_still(p)
said["steps_up"] = p.position
p.move_absolute(-20)
until_still(p)
said["steps_down"] = p.position
# scan
p.set_property(":MMOD", 2)
said["scan"] = []
for volts in (0, 25, 50, 75, 100, 75, 50, 25, 0):
    p.move_absolute(volts * 65535 // 100)
    until_still(p)
    said["scan"].append(p.position)
# closed loop
p.set_property(":MMOD", 0)
p.hold_time = 0
p.move_absolute(50_000_000)
until_still(p)
said["closed_loop"] = p.position
p.find_reference_mark(1)
until_still(p)
said["referenced"] = [p.position, p.is_physical_position_known]
try:
    p.set_property(":STEP:FREQ", 10**6)
except SmarActMCS2Error as error:
    said["error"] = str(error)
try:
    controller.write(":POS 0", 7)
except SmarActMCS2Error as error:
    said["channel_error"] = str(error)
p.stop()
said["after"] = p.status.ACTIVELY_MOVING
controller._comm.close()
print(json.dumps(said))
