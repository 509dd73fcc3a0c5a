"""A stick-slip stage as an instrument of QCoDeS, and a sweep of its voltage into a database:
python qcodes_stage.py HOST:PORT FOLDER."""

import json
import sys
from pathlib import Path

from qcodes.dataset import Measurement, initialise_or_create_database_at, load_or_create_experiment
from qcodes.instrument import Instrument
from qcodes.validators import Ints, Numbers

from stickslip.rig.devices.smaract import Mcs2Client
from stickslip.rig.positioner import wait


class StickSlipStage(Instrument):
    """An axis of a positioner: amplitude, rate, position, and steps that are taken when they are set."""

    def __init__(self, name, positioner, axis):
        super().__init__(name)
        self._positioner, self._axis = positioner, axis
        can = positioner.ranges
        allowed = Numbers(can.min_voltage, can.max_voltage)
        self.add_parameter("amplitude", unit="V", initial_value=80.0, set_cmd=None, vals=allowed)
        allowed = Numbers(can.min_frequency, can.max_frequency)
        self.add_parameter("rate", unit="Hz", initial_value=100.0, set_cmd=None, vals=allowed)
        unit = "m" if can.sensor else "steps"
        self.add_parameter("position", unit=unit, get_cmd=lambda: positioner.position(axis))
        self.add_parameter("steps", set_cmd=self._step, vals=Ints(-can.max_steps, can.max_steps))
        self.connect_message()

    def _step(self, count):
        self._positioner.step(self._axis, count, self.amplitude(), self.rate())
        wait(self._positioner, self._axis)

    def get_idn(self):
        """Maker and device."""
        model, _, serial = self._positioner.ranges.name.partition(" ")
        return {"vendor": None, "model": model, "serial": serial, "firmware": None}

    def close(self):
        """Stop, and let go."""
        if hasattr(self, "_positioner"):
            self._positioner.stop()
            self._positioner.close()
        super().close()


if __name__ == "__main__":
    host, _, port = sys.argv[1].rpartition(":")
    initialise_or_create_database_at(Path(sys.argv[2]) / "walks.db")
    load_or_create_experiment("stick-slip", sample_name="twin")
    stage = StickSlipStage("stage", Mcs2Client(host, port=int(port), timeout=30.0), 0)
    measurement = Measurement()
    measurement.register_parameter(stage.amplitude)
    measurement.register_parameter(stage.position, setpoints=(stage.amplitude,))
    with measurement.run() as saver:
        for volts in (40.0, 60.0, 80.0):
            stage.amplitude(volts)
            stage.steps(10)
            saver.add_result((stage.amplitude, volts), (stage.position, stage.position()))
    found = saver.dataset.get_parameter_data()["stage_position"]
    refused = ""
    try:
        stage.amplitude(1000.0)
    except ValueError as error:
        refused = str(error)
    stage.close()
    print(json.dumps({key: value.tolist() for key, value in found.items()} | {"refused": refused}))
