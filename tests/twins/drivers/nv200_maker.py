"""The maker's library nv200 moves what listens at a port, and says how it went, as JSON."""

import asyncio
import json
import sys

import numpy as np
from nv200.data_recorder import DataRecorder, DataRecorderSource, RecorderAutoStartMode
from nv200.nv200_device import NV200Device
from nv200.shared_types import DeviceError, PidLoopMode
from nv200.telnet_protocol import TelnetProtocol
from nv200.waveform_generator import WaveformGenerator


async def main(port):
    said = {}
    device = NV200Device(TelnetProtocol("127.0.0.1", port))
    await device.connect(auto_adjust_comm_params=False)
    said["unit"] = await device.get_position_unit()
    said["slew"] = await device.get_slew_rate()
    said["range"] = await device.get_setpoint_range()
    await device.pid.set_mode(PidLoopMode.OPEN_LOOP)
    # scan: the piezo bends, and comes back another way
    said["scan"] = []
    for volts in (0, 25, 50, 75, 100, 75, 50, 25, 0):
        await device.set_setpoint(volts)
        await asyncio.sleep(0.05)
        said["scan"].append(await device.get_current_position())
    # a walk of 20 steps with the generator, recorded
    recorder, generator = DataRecorder(device), WaveformGenerator(device)
    await recorder.set_data_source(0, DataRecorderSource.PIEZO_POSITION)
    await recorder.set_data_source(1, DataRecorderSource.PIEZO_VOLTAGE)
    await recorder.set_autostart_mode(RecorderAutoStartMode.START_ON_WAVEFORM_GEN_RUN)
    await recorder.set_recording_duration_ms(400)
    await recorder.start_recording()
    percent = np.append(np.linspace(10.0, 50.0, 39), 10.0)  # of -20 to 180 V: 0 to 80 V
    await generator.set_waveform_buffer(percent.tolist())
    await generator.set_output_sampling_time(500)
    await generator.set_loop_start_index(0)
    await generator.set_loop_end_index(39)
    await generator.set_start_index(0)
    await generator.set_cycles(20)
    said["before"] = await device.get_current_position()
    await generator.start()
    while await generator.is_running():
        await asyncio.sleep(0.05)
    await recorder.wait_until_finished()
    said["after"] = await device.get_current_position()
    position, voltage = await recorder.read_recorded_data()
    said["samples"] = len(position.values), len(voltage.values)
    said["recorded"] = [position.values[0], position.values[-1]]
    said["volts"] = [min(voltage.values), max(voltage.values)]
    # the closed loop holds a position near by
    await device.pid.set_mode(PidLoopMode.CLOSED_LOOP)
    target = round(said["after"] + 1.0, 3)
    await device.move_to_position(target)
    await asyncio.sleep(0.3)
    said["target"], said["held"] = target, await device.get_current_position()
    try:
        await device.set_setpoint(1e4)
    except DeviceError as error:
        said["error"] = error.error_code.value
    await device.close()
    print(json.dumps(said, default=str))


asyncio.run(main(int(sys.argv[1])))
