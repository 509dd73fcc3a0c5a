"""Piezosystem jena's amplifier NV200/D NET as a rig: its generator and its recorder, on one clock.

The drive must fit into a table of 1024 values, of which the generator can repeat the last part as a loop. A
longer drive must therefore be periodic, with a period of a whole number of updates, or end in a constant. The
recorder has two channels of 6144 samples, which are read after the run.
"""

from __future__ import annotations

import json
import math
import time

import numpy as np

from ....quantities import registry
from ....quantities.units import QuantityError, to_si
from ...line import Line, finite
from ...protocols import About, Array, Capabilities, RigError
from ...table import check_positive

PORT = 23
TICK = 50e-6  # shortest interval of generator and recorder, s; other intervals are multiples of this one
# Greatest number of values in the generator's table, and greatest number of samples of a recorder channel.
TABLE, RECORD = 1024, 6144
_ON, _OFF = b"\x11", b"\x13"
_ERRORS = {
    1: "error not specified",
    2: "unknown command",
    3: "parameter missing",
    4: "admissible range exceeded",
    5: "too many parameters",
    6: "locked",
    7: "underload",
    8: "overload",
    9: "too low",
    10: "too high",
}
_SOURCES = {"position": 0, "drive": 2}
_POLL = 0.02  # pause between two queries for the end of the recording, s


class Nv200Rig:
    """The amplifier NV200/D NET of piezosystem jena, as a `protocols.Rig`.

    Args:
        host: address of the amplifier.
        port: TCP port for data; 23 unless it was changed.
        interval: time between updates of the output and between samples, s: a multiple of 50 us, up to 3.27
            s.
        ramp: slew rate of the ramp to 0 V at the opening, V/s. The ramp is needed because a killed program
            leaves its last voltage.
        timeout: longest wait for each answer, s.

    Inputs are "drive", the voltage at the piezo, and "position", the reading of the sensor. Opening switches
    generator, closed loop and filters off.

    Raises:
        RigError: nobody answers there, or the device is another one.
        QuantityError: the interval is not possible.
    """

    about = About(
        device="piezosystem jena NV200/D NET (TCP)",
        does="puts out and records",
        samples="at the end of the run, 2 x 6144, up to 20 kHz",
        safe_state="ramp to 0 V by its slew rate; without a connection it keeps its voltage",
        verified="our twin, which the maker's library drives too; not run on hardware",
        ports=(PORT,),
    )

    def __init__(
        self,
        host: str,
        *,
        port: int = PORT,
        interval: float | str = TICK,
        ramp: float | str = 1000.0,
        timeout: float | str = 2.0,
    ) -> None:
        interval, self._timeout = to_si(interval, "s", "interval"), to_si(timeout, "s", "timeout")
        ramp = to_si(ramp, "V/s", "ramp")
        check_positive(ramp=ramp, timeout=self._timeout)
        self._factor = round(interval / TICK)
        if not 1 <= self._factor <= 65535 or abs(interval - self._factor * TICK) > 1e-9:
            raise QuantityError(f"interval = {interval:g} s must be a multiple of 50 us, up to 3.27 s")
        self._line = Line("NV200", host, port, self._timeout, closing=True)
        self._inputs: tuple[str, ...] = ()
        self._samples, self._loaded, self._running = 0, False, False
        self._volts: Array = np.zeros(1)
        with self._line.closed_on_refusal():
            self._greet()
            self._read_range()
            self.told_of = {name: ",".join(self._ask(name)).strip() for name in ("desc", "acserno", "sr")}
            for command in ("grun,0", "cl,0", "setlpon,0", "notchon,0"):
                self._do(command)
            self.stop(ramp)
        rate = 1.0 / (TICK * self._factor)
        self.capabilities = Capabilities(
            name=f"NV200 {self.told_of['desc']} {self.told_of['acserno']}",
            update_rate=rate,
            sample_rate=rate,
            min_voltage=self._low,
            max_voltage=self._high,
            step=(self._high - self._low) / 65536,
            max_points=RECORD,
            inputs={"drive": "V", "position": "m"},
            streams=False,
        )

    def refresh(self) -> None:
        """Read the voltage range of the amplifier again into `capabilities`: somebody may have changed the
        range at the device."""
        self._read_range()
        step = (self._high - self._low) / 65536
        can = self.capabilities
        self.capabilities = can._replace(min_voltage=self._low, max_voltage=self._high, step=step)

    def _read_range(self) -> None:
        self._low, self._high = self._number("avmin"), self._number("avmax")
        # The values of the generator's table are fractions of this range. A wrongly read range would scale
        # the output, so the range is read twice.
        again = self._number("avmin"), self._number("avmax")
        if again != (self._low, self._high) or not self._low <= 0.0 < self._high:
            self._line.fail(f"avmin, avmax are {self._low:g}, {self._high:g} V, then {again} V")

    def told(self, runs: int) -> dict[str, str]:
        """Return attributes of a recording, whatever its number of `runs`: "device", a JSON text with the
        device's identity and sampling interval [s]."""
        del runs
        return {
            "device": json.dumps({"device": "NV200/D_NET", **self.told_of, "interval": self._factor * TICK})
        }

    def load(self, volts: Array) -> None:
        """Load the drive [n], V, one value per update, into the generator's table.

        Raises:
            RigError: the drive is longer than the table even with a loop, repeats more than 65535 times, or
                is outside the voltage range; or the device refuses.
        """
        first, period, cycles = loop_of(volts, self.capabilities.step)
        size = first + period
        if size > TABLE:
            raise RigError(
                f"NV200: the drive of {volts.size} values needs {size} in the table, which has {TABLE}: a "
                "longer interval, or one of which a period of the drive is a multiple, makes it shorter"
            )
        if cycles > 65535:
            raise RigError(f"NV200: the drive repeats {cycles} times; the generator does up to 65535")
        if float(volts.min()) < self._low or float(volts.max()) > self._high:
            raise RigError(f"NV200: the drive is not within {self._low:g} to {self._high:g} V")
        self._loaded = False
        for index, value in enumerate(
            (100.0 * (volts[:size] - self._low) / (self._high - self._low)).tolist()
        ):
            self._do(f"gbarb,{index},{value:.6f}")
        for name, value in (
            ("gtarb", self._factor),
            ("goarb", 0),
            ("gsarb", first),
            ("gearb", size - 1),
            ("gcarb", cycles),
        ):
            self._do(f"{name},{value}")
        self._loaded, self._volts = True, np.array(volts, dtype=float)

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Arm the recorder: it starts with the output and records `samples` samples of one or two inputs,
        "drive" or "position". RigError for another input or a wrong number of inputs or samples."""
        for name in inputs:
            if name not in _SOURCES:
                raise RigError(f"NV200: there is no input {name!r}; there are {', '.join(_SOURCES)}")
        if not 1 <= samples <= RECORD or not 1 <= len(inputs) <= 2:
            raise RigError(
                f"NV200: it records 1 or 2 inputs, 1 to {RECORD} samples; not {len(inputs)}, {samples}"
            )
        for channel, name in enumerate(inputs):
            self._do(f"recsrc,{channel},{_SOURCES[name]}")
        for command in ("recrun,0", "recast,2", f"recstr,{self._factor}", f"reclen,{samples}", "recrun,1"):
            self._do(command)
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start the generator, and with it the armed recorder. RigError before `load` and `arm`."""
        if not self._loaded or not self._samples:
            raise RigError("NV200: start needs a drive (load) and inputs (arm)")
        self._do("modsrc,3")
        self._do("grun,1")
        self._running = True

    def fetch(self) -> Array:
        """Return all samples [inputs, n], in V and m, when the recording is complete; before, n is 0.

        Raises:
            RigError: no run is active, or another number of samples came.
        """
        if not self._running:
            raise RigError("NV200: nothing is running")
        if self._number("recrun") != 0.0:
            time.sleep(_POLL)
            return np.zeros((len(self._inputs), 0))
        rows = []
        for channel, name in enumerate(self._inputs):
            found = self._ask(f"recoutf,{channel}", 3.0 * self._timeout)[1:]
            try:
                values = np.array([float(one) for one in found])
            except ValueError as error:
                self._line.fail(f"recoutf,{channel}: {str(error)[:60]}")
            if values.size != self._samples:
                raise RigError(f"{self._line.device}: {values.size} samples came of {self._samples}")
            rows.append(values * (1e-6 if name == "position" else 1.0))
        return np.array(rows)

    def stop(self, slew: float) -> None:
        """Ramp to 0 V at `slew` [V/s], by the slew-rate limit of the device, and remove the limit afterwards.

        The device allows limits up to 2000 % of its voltage range per ms. The method waits as long as a ramp
        from the largest voltage of the range would last, 10 s at most.

        Raises:
            RigError: the commands could not be sent, also on a new connection; the output may keep its
                voltage.
        """
        percent = slew / (self._high - self._low) * 0.1  # slew rate in % of the voltage range per ms
        self._running = False
        commands = ("grun,0", f"sr,{min(max(percent, 8e-7), 2000.0):.7g}", "set,0", "modsrc,0")
        self._line.insist(lambda: [self._do(command) for command in commands], self._greet)
        longest = max(self._high, -self._low) / slew
        if math.isfinite(longest):
            time.sleep(min(longest, 10.0))
        self._do("sr,2000")

    def output(self) -> tuple[Array, Array]:
        """Return the output waveform of the loaded drive, piecewise linear: times [s] from the start, and
        voltages [V].

        A new value is assumed to be reached linearly within 50 us (not measured on a device).
        """
        begins: Array = np.arange(self._volts.size, dtype=np.float64) * (TICK * self._factor)
        times: Array = np.stack([begins, begins + TICK], axis=1).ravel()
        volts: Array = np.stack([np.append(0.0, self._volts[:-1]), self._volts], axis=1).ravel()
        keep = np.append(np.diff(times) > 0.0, True)
        return times[keep], volts[keep]

    def close(self) -> None:
        """Close the connection. The output keeps its voltage."""
        self._line.close()

    def _greet(self) -> None:
        """Raise RigError unless the device identifies itself as an NV200/D_NET."""
        self._line.send(b"\r\n")
        found = self._line.until(_ON, b"\r\n").strip(b"\r\n\x00<>" + _OFF)
        if found != b"NV200/D_NET":
            self._line.fail(f"it says it is {found[:60]!r}, not an NV200/D_NET")

    def _number(self, command: str) -> float:
        found = self._ask(command)
        try:
            return finite(found[0])
        except ValueError:
            self._line.fail(f"{command} is answered by {found[0][:60]!r}, no number")

    def _ask(self, command: str, timeout: float | None = None) -> list[str]:
        """Return the values in the answer to a query, as texts. The answer is the query's name and the
        values, separated by commas; RigError for any other answer. `timeout` is in s, by default the
        connection's."""
        name, *found = self._said(command, timeout).split(",")
        if name != command.split(",")[0] or not found:
            self._line.fail(f"{command} is answered by {','.join([name, *found])[:60]!r}")
        return found

    def _do(self, command: str) -> None:
        said = self._said(command)
        if said:
            self._line.fail(f"{command} is answered by {said[:60]!r}")

    def _said(self, command: str, timeout: float | None = None) -> str:
        asked = command.encode("latin-1") + b"\r\n"
        self._line.send(asked)
        said = self._line.until(_ON, asked, timeout).decode("latin-1").strip("\x13\r\n\x00 ")
        if said.startswith("error"):
            number = said.partition(",")[2].strip()
            why = _ERRORS.get(int(number), "unknown error") if number.isdecimal() else "unknown error"
            raise RigError(f"{self._line.device}: {command}: {why} ({said})")
        return said


def loop_of(volts: Array, within: float) -> tuple[int, int, int]:
    """Find the shortest generator table that plays a drive: some values once, then a loop of values.

    After the last cycle the generator keeps the last value. The table of a drive that ends in a constant can
    therefore end with the last change, if the values up to there are whole cycles.

    Args:
        volts: the drive [n], V, one value per update.
        within: largest difference of values that count as equal, V.

    Returns:
        Number of values before the loop, number of values in the loop, number of cycles of the loop.
    """
    changes = np.flatnonzero(np.abs(volts - volts[-1]) > within)
    # Number of values up to and including the first one of the constant with which the drive ends.
    held = min(int(changes[-1]) + 2 if changes.size else 1, volts.size)
    best = held - 1, 1, 1
    for values, whole in ((volts, False), (volts[:held], True)):
        for period in range(1, min(TABLE, values.size - 1) + 1):
            differs = np.flatnonzero(np.abs(values[period:] - values[:-period]) > within)
            first = int(differs[-1]) + 1 if differs.size else 0
            if whole:
                first += (values.size - first) % period
            if first < values.size and first + period < best[0] + best[1]:
                best = first, period, math.ceil((values.size - first) / period)
    return best


registry.rigs.add(Nv200Rig, "nv200")
