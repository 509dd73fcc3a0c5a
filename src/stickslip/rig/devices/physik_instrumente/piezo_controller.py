"""A digital piezo controller of Physik Instrumente as a rig: wave generator and data recorder, through GCS
2.0.

The module is for controllers such as E-709 and E-727. The servo (closed loop) is off, so that the wave table
is the piezo's voltage. Position and voltage are recorded at multiples of the servo's cycle time.
"""

from __future__ import annotations

import json
import time

import numpy as np

from ....quantities import registry
from ....quantities.units import QuantityError, to_si
from ...protocols import About, Array, Capabilities, RigError
from ...table import check_followed, check_inputs, check_positive, check_ready, held, lower, with_ramp, within
from .gcs import PORT, GcsLine

_CYCLE = "SPA? 1 0x0E000200"  # query of the servo's cycle time, which the controller answers in s
_OPTIONS = {"position": 2, "drive": 16}  # numbers by which the data recorder designates the inputs of the rig
_AT_A_TIME = 10  # number of table values in one command, whose length the controller limits
_POLL = 0.02  # pause between two queries for the end of the recording, s
_STEPS = 50  # largest number of voltage steps in which a stop reduces the voltage to 0 V
_LATE = 5.0  # time after the end of the wave table within which the recording must be complete, s
_BEYOND = 0.1  # accepted distance of a reading beyond either end of its range, as a fraction of the range


class PiRig:
    """A piezo controller of Physik Instrumente that uses GCS, as a `protocols.Rig`.

    Args:
        host: address of the controller.
        axis: name of the controller's axis, driven by its first output channel and wave generator.
        interval: time between updates of the output and between samples, s; a multiple of the servo's cycle
            time.
        points: greatest number of values of a wave table and of a record, from the controller's manual.
        ramp: slew rate of the ramp to 0 V that ends each drive, V/s. Opening also switches the servo off and
            makes such a ramp, because a killed program leaves its last voltage.
        port: TCP port.
        timeout: longest wait for each answer, s.

    Inputs are "drive", the voltage at the piezo, and "position", the reading of the sensor.

    Raises:
        RigError: nobody answers there, or the device is another one.
        QuantityError: a value is out of range.
    """

    about = About(
        device="Physik Instrumente, digital piezo controllers such as E-709, E-727 (GCS 2.0, TCP)",
        does="puts out and records",
        samples="at the end of the run, as many as its tables hold",
        safe_state="steps to 0 V by SVA; a table ends at 0 V without the program too",
        verified="a controller simulated in the tests, which PI's pipython drives too; not run on hardware",
    )

    def __init__(
        self,
        host: str,
        *,
        axis: str = "1",
        interval: float | str = 100e-6,
        points: int = 8192,
        ramp: float | str = 1000.0,
        port: int = PORT,
        timeout: float | str = 5.0,
    ) -> None:
        interval, ramp = to_si(interval, "s", "interval"), to_si(ramp, "V/s", "ramp")
        timeout = to_si(timeout, "s", "timeout")
        check_positive(interval=interval, points=points, ramp=ramp, timeout=timeout)
        self._line = GcsLine(host, port, timeout)
        self._axis, self._ramp = axis, ramp
        self._inputs: tuple[str, ...] = ()
        self._volts: Array = np.zeros(0)
        self._samples, self._running = 0, False
        self._lasts = self._ends = 0.0
        try:
            cycle = self._line.number(_CYCLE)
            self._factor = max(round(interval / cycle), 1) if cycle > 0.0 else 1
            if abs(interval - self._factor * cycle) > 1e-3 * interval:
                raise QuantityError(
                    f"interval = {interval:g} s must be a multiple of {cycle:g} s, the servo's cycle"
                )
            self._read_range()
            # Range of credible position readings, um: the sensor's travel, extended by `_BEYOND` at each end.
            ends = [self._line.number(f"{name}? {axis}") for name in ("TMN", "TMX")]
            self._travel = ends[0] - _BEYOND * (ends[1] - ends[0]), ends[1] + _BEYOND * (ends[1] - ends[0])
            self._line.do("WGO 1 0")
            self._line.do(f"SVO {axis} 0")
            self._go_to_zero(ramp, False)
        except (RigError, QuantityError):
            self._line.close()
            raise
        self.capabilities = Capabilities(
            name=f"PI {self._line.model}",
            update_rate=1.0 / interval,
            sample_rate=1.0 / interval,
            min_voltage=min(self._low, 0.0),
            max_voltage=max(self._high, 0.0),
            step=(self._high - self._low) / 65536,
            max_points=points - 1,
            inputs={"drive": "V", "position": "m"},
            streams=False,
            own_slew=ramp,
        )

    def refresh(self) -> None:
        """Read the voltage range of the output again into `capabilities`: somebody may have changed the range
        at the controller."""
        self._read_range()
        low, high = min(self._low, 0.0), max(self._high, 0.0)
        step = (self._high - self._low) / 65536
        self.capabilities = self.capabilities._replace(min_voltage=low, max_voltage=high, step=step)

    def _read_range(self) -> None:
        self._low, self._high = (self._line.number(f"{name}? 1") for name in ("VMI", "VMA"))

    def told(self, runs: int) -> dict[str, str]:
        """Return attributes of a recording, whatever its number of `runs`: "device", a JSON text with the
        controller's identity, axis and sampling interval [s]."""
        del runs
        known = {
            "device": self._line.identity,
            "axis": self._axis,
            "interval": 1.0 / self.capabilities.update_rate,
        }
        return {"device": json.dumps(known)}

    def load(self, volts: Array) -> None:
        """Load the drive [n], V, one value per update, into the wave table, with a ramp to 0 V at its end.

        Raises:
            RigError: the table is too long or exceeds the voltage range, or the controller refuses.
        """
        can = self.capabilities
        table = with_ramp(np.asarray(volts, dtype=float), self._ramp, can.update_rate)
        within(can.name, table, can.min_voltage, can.max_voltage, can.max_points + 1)
        self._volts = np.zeros(0)
        for begin in range(0, table.size, _AT_A_TIME):
            some = table[begin : begin + _AT_A_TIME]
            values = " ".join(f"{one:.5f}" for one in some)
            self._line.do(f"WAV 1 {'&' if begin else 'X'} PNT 1 {some.size} {values}")
        for command in (f"WTR 0 {self._factor} 0", "WSL 1 1", "WGC 1 1", "WOS 1 0"):
            self._line.do(command)
        self._volts, self._lasts = np.array(volts, dtype=float), table.size / can.update_rate

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Set up the data recorder: it starts with the wave generator and records `samples` samples of each
        input, "drive" or "position". RigError for another input or too many samples."""
        can = self.capabilities
        check_inputs(can, inputs, samples)
        self._line.do(f"RTR {self._factor}")
        for table, name in enumerate(inputs, 1):
            source = self._axis if name == "position" else "1"
            self._line.do(f"DRC {table} {source} {_OPTIONS[name]}")
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start the wave generator, which also starts the data recorder. RigError before `load` and `arm`."""
        check_ready(self.capabilities, self._volts, self._samples)
        self._running, self._ends = True, time.monotonic() + self._lasts + 1.0
        self._line.do("WGO 1 1")
        self._ends = time.monotonic() + self._lasts

    def fetch(self) -> Array:
        """Return all samples [inputs, n], in V and m, when the recording is complete; before, n is 0.

        Raises:
            RigError: no run is active, the recording is not complete in time, or its readings are wrong.
        """
        if not self._running:
            raise RigError(f"{self.capabilities.name}: nothing is running")
        if self._line.number("DRL? 1") < self._samples + 1:
            if time.monotonic() > self._ends + _LATE:
                raise RigError(f"{self._line.name}: DRL? 1: it does not record so many samples")
            time.sleep(_POLL)
            return np.zeros((len(self._inputs), 0))
        tables = " ".join(str(i + 1) for i in range(len(self._inputs)))
        query = f"DRR? 1 {self._samples + 1} {tables}"
        rows = self._line.table(query)
        if len(rows) != self._samples + 1 or any(len(row) != len(self._inputs) for row in rows):
            raise RigError(f"{self._line.name}: {query}: {len(rows)} rows came")
        self._check(np.array(rows[1:]).T)
        # The controller reports positions in um; a rig returns m.
        scale = np.array([1e-6 if name == "position" else 1.0 for name in self._inputs])
        return (np.array(rows[1:]) * scale).T  # the first row precedes the drive's first value

    def _check(self, found: Array) -> None:
        """Raise RigError if the readings `found` [inputs, n], in V and um, are outside the range of sensor or
        output, or if the recorded drive does not follow the loaded one."""
        spare = _BEYOND * (self._high - self._low)
        for name, values in zip(self._inputs, found, strict=True):
            low, high = self._travel if name == "position" else (self._low - spare, self._high + spare)
            unit = "um" if name == "position" else "V"
            wrong = values[(values < low) | (values > high)]
            if wrong.size:
                raise RigError(
                    f"{self._line.name}: {name} = {wrong[0]:.4g} {unit} came, which is not within "
                    f"{low:.4g} to {high:.4g} {unit}"
                )
            if name == "drive":
                check_followed(self._line.name, values, held(self._volts, values.size))

    def stop(self, slew: float) -> None:
        """Stop the wave generator and reduce the voltage to 0 V in steps, at `slew` [V/s] on average. If the
        wave table ends sooner, its end is awaited first.

        Raises:
            RigError: the controller did not answer as expected; 0 V was then commanded at once, unchecked.
        """
        running, self._running = self._running, False
        try:
            self._go_to_zero(slew, running)
        except RigError:
            self._line.tell("WGO 1 0")
            self._line.tell(f"SVA {self._axis} 0")
            raise

    def _go_to_zero(self, slew: float, running: bool) -> None:
        if running and 0.0 < self._ends - time.monotonic() <= float(np.abs(self._volts).max()) / slew:
            # The table ends at 0 V sooner than a ramp from here would, so its end is awaited.
            time.sleep(max(self._ends - time.monotonic(), 0.0))
        self._line.do("WGO 1 0")
        volts = self._line.number("VOL? 1")
        lower(lambda share: self._line.do(f"SVA {self._axis} {share * volts:.5f}"), abs(volts), slew, _STEPS)

    def close(self) -> None:
        """Close the connection. A running wave table continues to its end, where it is at 0 V."""
        self._line.close()


registry.rigs.add(PiRig, "pi")
