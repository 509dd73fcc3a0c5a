"""pylablib's driver of the KIM101 moves what listens at a port, and says how it went, as JSON."""

import json
import sys

from pylablib.devices.Thorlabs import KinesisPiezoMotor, ThorlabsError

said = {}
motor = KinesisPiezoMotor(("serial", f"socket://127.0.0.1:{sys.argv[1]}"))
said["device"] = motor.get_device_info().model_no
said["channels"] = motor.get_all_channels()
said["drive"] = motor.setup_drive(max_voltage=110, velocity=200, acceleration=10000, channel=2)
said["clipped"] = motor.setup_drive(max_voltage=300, channel=2).max_voltage
motor.setup_drive(max_voltage=110, channel=2)
said["before"] = motor.get_position(channel=2)
motor.enable_channels(2)  # with none enabled, the driver fails: it takes None for a list
motor.move_by(40, channel=2)
said["moving"] = motor.is_moving(channel=2)
motor.wait_move(channel=2, timeout=20)
said["forward"] = motor.get_position(channel=2)
motor.move_to(10, channel=2)
motor.wait_move(channel=2, timeout=20)
said["back"] = motor.get_position(channel=2)
motor.jog("+", channel=2)
said["jogging"] = motor.is_moving(channel=2)
motor.stop(channel=2)
said["stopped"] = motor.is_moving(channel=2)
said["moved"] = motor.get_position(channel=2)
motor.set_position_reference(0, channel=2)
said["reference"] = motor.get_position(channel=2)
said["status"] = motor.get_status(channel=2)
try:
    motor.query(0x08C1, 0x7F, 2)
except ThorlabsError as error:
    said["error"] = str(error)
said["after_error"] = motor.get_position(channel=2)
motor.close()
print(json.dumps(said))
