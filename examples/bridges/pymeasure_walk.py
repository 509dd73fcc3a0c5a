"""A walk as a procedure of PyMeasure, with its results in a file:
python pymeasure_walk.py HOST:PORT FILE.csv."""

import json
import sys

from pymeasure.experiment import FloatParameter, IntegerParameter, Parameter, Procedure, Results, Worker

from stickslip.rig.devices.smaract import Mcs2Client
from stickslip.rig.positioner import wait


class Walk(Procedure):
    """Bursts of steps, and where the stage is after each."""

    where = Parameter("Controller")
    voltage = FloatParameter("Amplitude", units="V", default=80.0, minimum=0.0, maximum=100.0)
    frequency = FloatParameter("Rate", units="Hz", default=100.0, minimum=1.0, maximum=20e3)
    steps = IntegerParameter("Steps of a burst", default=10)
    bursts = IntegerParameter("Bursts", default=3)
    DATA_COLUMNS = ["steps", "position (m)"]  # noqa: RUF012  # as PyMeasure has it

    def startup(self):
        """Connect."""
        host, _, port = self.where.rpartition(":")
        self.stage = Mcs2Client(host, port=int(port), timeout=30.0)

    def execute(self):
        """Walk."""
        for burst in range(1, self.bursts + 1):
            self.stage.step(0, self.steps, self.voltage, self.frequency)
            wait(self.stage, 0)
            self.emit("results", {"steps": burst * self.steps, "position (m)": self.stage.position(0)})
            self.emit("progress", 100.0 * burst / self.bursts)
            if self.should_stop():
                break

    def shutdown(self):
        """Stop, and let go; it is called after an error too."""
        self.stage.stop()
        self.stage.close()


if __name__ == "__main__":
    procedure = Walk(where=sys.argv[1])
    results = Results(procedure, sys.argv[2])
    worker = Worker(results)
    worker.start()
    worker.join(timeout=60)
    print(json.dumps({"rows": results.data.to_numpy().tolist(), "status": procedure.status}))
