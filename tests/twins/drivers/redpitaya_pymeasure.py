"""PyMeasure's driver of a Red Pitaya reads what listens at a port; its generator is told in plain text."""

import json
import sys
import time

import numpy as np
from pymeasure.instruments.redpitaya import RedPitayaScpi

board = RedPitayaScpi(ip_address="127.0.0.1", port=int(sys.argv[1]), visa_library="@py")
said = {"id": board.id, "buffer": board.buffer_length}
board.acquisition_reset()
board.decimation, board.average_skipped_samples = 4096, True
board.acq_units, board.acq_format = "VOLTS", "ASCII"
board.acq_trigger_delay_samples = 8192
said["decimation"], said["delay"] = board.decimation, board.acq_trigger_delay_samples
board.ain1.gain = "LV"
table = np.concatenate([np.linspace(0.0, 1.0, 500), np.linspace(0.0, 1.0, 500), np.zeros(100)])
for command in (
    "SOUR1:FUNC ARBITRARY",
    "SOUR1:TRAC:DATA:DATA " + ",".join(f"{one:.5f}" for one in table),
    "SOUR1:FREQ:FIX 10",
    "SOUR1:VOLT 0.6",
    "SOUR1:BURS:STAT BURST",
    "SOUR1:BURS:NCYC 1",
    "OUTPUT1:STATE ON",
):
    board.write(command)
board.acquisition_start()
board.acq_trigger_source = "AWG_PE"
said["before"] = board.acq_trigger_status
board.write("SOUR1:TRIG:INT")
while not board.acq_buffer_filled:
    time.sleep(0.02)
said["after"] = board.acq_trigger_status
sensor, drive = board.ain1.get_data(4000), board.ain2.get_data(4000)
said["samples"], said["volts"] = len(drive), [float(drive.min()), float(drive.max())]
said["walked"] = float(sensor[-1] - sensor[0])
board.write("OUTPUT1:STATE OFF")
print(json.dumps(said))
