"""A Red Pitaya as a rig, through its SCPI server: its generator drives an amplifier, its fast inputs record.

Generator and inputs have buffers of 16,384 values. The generator triggers the acquisition inside the board,
without a cable.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping

import numpy as np

from ....quantities import registry
from ....quantities.units import QuantityError, to_si
from ...protocols import About, Array, Capabilities, RigError
from ...scpi import ScpiInstrument
from ...table import (
    check_followed,
    check_inputs,
    check_positive,
    check_ready,
    fade_out,
    held,
    with_ramp,
    within,
)

PORT = 5000
CLOCK = 125e6  # sample clock of the board's A/D and D/A converters, Hz
BUFFER = 16384  # number of values in the buffers of the generator and of each input
_SPAN = {"LV": 1.0, "HV": 20.0}  # largest input voltage of either sign, V, by the setting of the jumpers
_OUT = 1.0  # largest output voltage of either sign, V
_BITS = 14  # resolution of the output's D/A converter, bits
_LEAST = 1e-3  # smallest amplitude that is sent to the generator, V; a smaller one is replaced by this value
_POLL = 0.02  # pause between two queries for a full buffer, s
_LATE = 5.0  # time after the expected end of the recording within which the buffer must be full, s


class RedPitayaRig:
    """The board Red Pitaya through its SCPI server, as a `protocols.Rig`.

    Args:
        host: address of the board.
        gain: gain of the amplifier at output 1, V at the piezo per V of the board.
        inputs: number of the board's fast input by name of the rig's input, such as {"gauge": 1}, in V. The
            rig also has an input "drive": the loaded drive, unless a fast input has this name.
        rate: update rate of the output and sampling rate of the inputs, Hz; rounded to 125 MHz divided by 1,
            2, 4, 8 or an integer from 16 to 65,536.
        jumpers: setting of the jumpers of the inputs: "LV" (range -1 to 1 V) or "HV" (-20 to 20 V).
        ramp: slew rate of the ramp to 0 V that ends each drive, V/s at the piezo.
        port: TCP port of the SCPI server.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: nobody answers there, or the device is another one.
        QuantityError: a value is out of range.
    """

    about = About(
        device="Red Pitaya STEMlab 125-14, its SCPI server (TCP, OS 2.00 or newer)",
        does="puts out and records",
        samples="at the end of the run, up to 16,384",
        safe_state="amplitude faded to 0 V, output off; a table ends at 0 V without the program too",
        verified="a board simulated in the tests, which PyMeasure's driver reads too; not run on hardware",
        ports=(PORT,),
    )

    @staticmethod
    def identify(host: str, port: int, timeout: float) -> str:
        """Return the identity that the board at an address reports. `timeout` is the longest wait for its
        answer, s. Raises RigError if nobody answers there, or another device."""
        asked = ScpiInstrument("instrument", host, port, timeout)
        asked.close()
        if "REDPITAYA" not in asked.identity.upper():
            raise RigError(f"{asked.name} says it is {asked.identity[:80]!r}, not a Red Pitaya")
        return asked.identity

    def __init__(
        self,
        host: str,
        *,
        gain: float,
        inputs: Mapping[str, int],
        rate: float | str = 20e3,
        jumpers: str = "LV",
        ramp: float | str = 1000.0,
        port: int = PORT,
        timeout: float | str = 5.0,
    ) -> None:
        rate, ramp = to_si(rate, "Hz", "rate"), to_si(ramp, "V/s", "ramp")
        timeout = to_si(timeout, "s", "timeout")
        check_positive(gain=gain, rate=rate, ramp=ramp, timeout=timeout)
        self._decimation = round(CLOCK / rate)
        if self._decimation not in (1, 2, 4, 8) and not 16 <= self._decimation <= 65536:
            raise QuantityError(f"rate = {rate:g} Hz must be 125 MHz by 1, 2, 4, 8 or 16 to 65536")
        if jumpers not in _SPAN or not inputs or not set(inputs.values()) <= {1, 2}:
            raise QuantityError(
                f"jumpers = {jumpers!r} must be LV or HV, inputs = {dict(inputs)} name 1 and 2"
            )
        self._rate, self._gain, self._ramp = CLOCK / self._decimation, gain, ramp
        self._channels, self._span = dict(inputs), _SPAN[jumpers]
        self._link = ScpiInstrument("Red Pitaya", host, port, timeout, end=b"\r\n")
        self._volts: Array = np.zeros(0)
        self._inputs: tuple[str, ...] = ()
        self._samples, self._running = 0, False
        self._lasts = self._ends = self._amplitude = 0.0
        try:
            if "REDPITAYA" not in self._link.identity.upper():
                raise RigError(f"{self._link.name} says it is {self._link.identity[:80]!r}, not a Red Pitaya")
            self._do("OUTPUT1:STATE OFF", "GEN:RST", *(f"ACQ:SOUR{n}:GAIN {jumpers}" for n in (1, 2)))
        except RigError:
            self._link.close()
            raise
        self.capabilities = Capabilities(
            name="Red Pitaya",
            update_rate=self._rate,
            sample_rate=self._rate,
            min_voltage=-gain * _OUT,
            max_voltage=gain * _OUT,
            step=gain * 2.0 * _OUT / 2**_BITS,
            max_points=BUFFER - 1,
            inputs={"drive": "V", **dict.fromkeys(self._channels, "V")},
            streams=False,
            own_slew=ramp,
        )

    def told(self, runs: int) -> dict[str, str]:
        """Return attributes of a recording, whatever its number of `runs`: "device", a JSON text with the
        board's identity, gain, inputs and input range [V]."""
        del runs
        known = {
            "device": self._link.identity,
            "gain": self._gain,
            "inputs": self._channels,
            "span": self._span,
        }
        return {"device": json.dumps(known)}

    def load(self, volts: Array) -> None:
        """Switch the output off; upload the drive [n], V at the piezo, one per update, and a ramp to 0 V.

        Raises:
            RigError: drive and ramp exceed the buffer or the voltage range, or the board refuses.
        """
        can = self.capabilities
        table = with_ramp(np.asarray(volts, dtype=float), self._ramp, self._rate)
        within(can.name, table, can.min_voltage, can.max_voltage, BUFFER)
        self._volts = np.zeros(0)
        table = table / self._gain
        self._amplitude = max(float(np.abs(table).max()), _LEAST)
        self._do(
            *("OUTPUT1:STATE OFF", "SOUR1:FUNC ARBITRARY"),
            "SOUR1:TRAC:DATA:DATA " + ",".join(f"{one:.6f}" for one in table / self._amplitude),
            f"SOUR1:FREQ:FIX {self._rate / table.size:.9g}",
            *("SOUR1:VOLT:OFFS 0", f"SOUR1:VOLT {self._amplitude:.6f}"),
            *("SOUR1:BURS:STAT BURST", "SOUR1:BURS:NCYC 1", "SOUR1:BURS:NOR 1", "SOUR1:TRIG:SOUR INT"),
        )
        self._volts, self._lasts = np.array(volts, dtype=float), table.size / self._rate

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Set up the acquisition: it starts with the output and records `samples` samples of each input.

        RigError for an unknown input or too many samples.
        """
        can = self.capabilities
        check_inputs(can, inputs, samples)
        self._do(
            *("ACQ:STOP", "ACQ:RST", f"ACQ:DEC {self._decimation}", "ACQ:AVG ON"),
            *("ACQ:DATA:FORMAT ASCII", "ACQ:DATA:UNITS VOLTS"),
            # The board counts this delay, in samples, from the middle of its buffer. With this value the
            # samples of the drive are the last ones in the buffer.
            f"ACQ:TRIG:DLY {samples + 1 - BUFFER // 2}",
        )
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start the generator, whose trigger starts the acquisition. RigError before `load` and `arm`."""
        check_ready(self.capabilities, self._volts, self._samples)
        self._do("ACQ:START", "ACQ:TRIG AWG_PE", "OUTPUT1:STATE ON")
        self._running, self._ends = True, time.monotonic() + self._lasts + 1.0
        self._do("SOUR1:TRIG:INT")
        self._ends = time.monotonic() + self._lasts

    def fetch(self) -> Array:
        """Return all samples [inputs, n], V, when the buffer is full; before, n is 0.

        Raises:
            RigError: no run is active, the buffer does not fill in time, an input was out of range, or the
                recorded drive is another signal than the loaded one.
        """
        if not self._running:
            raise RigError(f"{self.capabilities.name}: nothing is running")
        if self._link.ask("ACQ:TRIG:FILL?") != "1":
            if time.monotonic() > self._ends + self._samples / self._rate + _LATE:
                raise RigError(f"{self._link.name}: ACQ:TRIG:FILL?: its buffer does not fill")
            time.sleep(_POLL)
            return np.zeros((len(self._inputs), 0))
        played = held(self._volts, self._samples)
        channels = self._channels
        rows = [self._read(channels[n]) if n in channels else played for n in self._inputs]
        if "drive" in channels and "drive" in self._inputs:
            check_followed(self.capabilities.name, rows[self._inputs.index("drive")], played)
        return np.array(rows)

    def stop(self, slew: float) -> None:
        """Reduce the amplitude to 0 V at `slew` [V/s at the piezo], or await the end of the table if that is
        sooner; then switch the output off.

        The output is switched off even if reducing the amplitude fails.
        """
        running, self._running = self._running, False
        try:
            if running:
                greatest = float(np.abs(self._volts).max(initial=0.0))
                fade_out(self._fade, greatest, slew, self._ends)
        finally:
            self._link.tell("OUTPUT1:STATE OFF")
            self._link.check("OUTPUT1:STATE OFF")

    def close(self) -> None:
        """Close the connection. A running table continues to its end, where it is at 0 V."""
        self._link.close()

    def _fade(self, share: float) -> None:
        self._do(f"SOUR1:VOLT {max(share * self._amplitude, _LEAST):.6f}")

    def _read(self, channel: int) -> Array:
        """Return the samples [n] of the fast input `channel` (1 or 2), V, from the first value of the drive
        on, one sample after the trigger. RigError if the answer is wrong or the input was out of range."""
        query = f"ACQ:SOUR{channel}:DATA?"
        said = self._link.ask(query)
        try:
            found = np.array([float(one) for one in said.strip("{}").split(",")])
        except ValueError:
            found = np.zeros(0)
        if found.size != BUFFER or not np.all(np.isfinite(found)):
            raise RigError(f"{self._link.name}: {query} is answered by {said[:60]!r}, {found.size} numbers")
        found = found[-self._samples :]
        if np.abs(found).max() >= 0.999 * self._span:
            raise RigError(f"{self._link.name}: input {channel} was beyond {self._span:g} V")
        return found

    def _do(self, *commands: str) -> None:
        for command in commands:
            self._link.do(command)


registry.rigs.add(RedPitayaRig, "redpitaya")
