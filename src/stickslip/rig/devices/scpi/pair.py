"""A function generator and an oscilloscope as a rig, both controlled by SCPI commands.

The generator's output goes to an amplifier of known gain, which drives the piezo. The generator's sync output
triggers the oscilloscope, whose channels read the sensors. `generators` and `oscilloscopes` hold the commands
of each family, which is recognised by the instrument's identity.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from typing import ClassVar

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
from .generators import Generator
from .oscilloscopes import Oscilloscope

_SAMPLES = 50_000  # largest number of samples of a recording; an InfiniiVision has 62,500 on its screen
_SPAN = 8.0  # default of `spans`: voltage from the bottom to the top of the screen, V
_POLL = 0.02  # pause between two queries for the end of the acquisition, s
_JITTER = 1e-6  # uncertainty of the delay between output and recording, s; assumed for a trigger cable
_LATE = 5.0  # time after the end of the recorded time within which the acquisition must have ended, s


class PairRig:
    """A function generator and an oscilloscope that use SCPI, together as a `protocols.Rig`.

    Args:
        generator, oscilloscope: address: "HOST" (port 5025), "HOST:PORT" (Rigol's port is 5555, Tektronix's
            4000), or a VISA resource (needs pyvisa).
        gain: gain of the amplifier, V at the piezo per V of the generator.
        inputs: oscilloscope channel by name of the rig's input, such as {"gauge": 2}, all in V. The rig also
            has an input "drive": the loaded drive, unless a channel has this name.
        spans: voltage from the bottom to the top of the screen, V, by name of the input; 8 V by default.
        rate: update rate of the output and sampling rate of the inputs, Hz.
        ramp: slew rate of the ramp to 0 V that ends each drive, V/s at the piezo.
        output: number of the generator's output.
        trigger: trigger source as the oscilloscope calls it, such as "EXT" or "CHAN1".
        level: trigger level, V.
        timeout: longest wait for each answer, s.

    Raises:
        RigError: an instrument does not answer, or its family is unknown.
        QuantityError: a value is out of range.
    """

    about = About(
        device="a function generator and an oscilloscope by SCPI (families: see the page)",
        does="puts out and records",
        samples="at the end of the run, up to 50,000",
        safe_state="amplitude faded to 0 V, output off; a table ends at 0 V without the program too",
        verified="our twins, which PyMeasure's drivers of 33500 and DSOX1102G drive too; not run on hardware",
        ports=(5025, 5555, 4000),
    )

    # `attached.probe` asks this client last at an address, because other devices also answer its query *IDN?.
    asked_last: ClassVar[bool] = True

    @staticmethod
    def identify(host: str, port: int, timeout: float) -> str:
        """Return the identity that an SCPI instrument at an address reports. `timeout` is the longest wait
        for its answer, s. Raises RigError if no instrument answers."""
        asked = ScpiInstrument("instrument", host, port, timeout)
        asked.close()
        return asked.identity

    def __init__(
        self,
        generator: str,
        oscilloscope: str,
        *,
        gain: float,
        inputs: Mapping[str, int],
        spans: Mapping[str, float | str] | None = None,
        rate: float | str = 20e3,
        ramp: float | str = 1000.0,
        output: int = 1,
        trigger: str = "EXT",
        level: float | str = 1.0,
        timeout: float | str = 5.0,
    ) -> None:
        rate, ramp = to_si(rate, "Hz", "rate"), to_si(ramp, "V/s", "ramp")
        level, timeout = to_si(level, "V", "level"), to_si(timeout, "s", "timeout")
        self._spans = {name: to_si(span, "V", f"spans.{name}") for name, span in (spans or {}).items()}
        check_positive(gain=gain, rate=rate, ramp=ramp, timeout=timeout, **self._spans)
        if not inputs or set(self._spans) - set(inputs):
            raise QuantityError(f"inputs = {dict(inputs)} must name a channel for each of spans")
        self._channels, self._rate, self._ramp, self._gain = dict(inputs), rate, ramp, gain
        self._generator = Generator(generator, output, timeout)
        try:
            self._oscilloscope = Oscilloscope(oscilloscope, trigger, level, timeout)
        except RigError:
            self._generator.link.close()
            raise
        one = self._generator.table
        if rate > one.max_rate:
            self.close()
            raise QuantityError(f"rate = {rate:g} Hz must be <= {one.max_rate:g} Hz for {one.name}")
        self._volts: Array = np.zeros(0)
        self._inputs: tuple[str, ...] = ()
        self._samples, self._running = 0, False
        # Duration of the table, s; time at which the table ends, and latest time at which the acquisition
        # must have ended, s of `time.monotonic`.
        self._lasts = self._ends = self._over = 0.0
        self.capabilities = Capabilities(
            name=f"{one.name} and {self._oscilloscope.table.name}",
            update_rate=rate,
            sample_rate=rate,
            min_voltage=-gain * one.volts,
            max_voltage=gain * one.volts,
            step=gain * one.volts / one.full,
            max_points=min(_SAMPLES, one.points // 2),
            inputs={"drive": "V", **dict.fromkeys(self._channels, "V")},
            streams=False,
            jitter=_JITTER,
            own_slew=ramp,
        )

    def told(self, runs: int) -> dict[str, str]:
        """Return attributes of a recording, whatever its number of `runs`: "device", a JSON text with both
        identities, gain and channels."""
        del runs
        known = {
            "generator": self._generator.link.identity,
            "oscilloscope": self._oscilloscope.link.identity,
            "gain": self._gain,
            "channels": self._channels,
        }
        return {"device": json.dumps(known)}

    def load(self, volts: Array) -> None:
        """Switch the output off; upload the drive [n], V at the piezo, one per update, and a ramp to 0 V.

        Raises:
            RigError: drive and ramp exceed the generator's table or voltage range, or the generator refuses
                them.
        """
        can = self.capabilities
        table = with_ramp(np.asarray(volts, dtype=float), self._ramp, self._rate)
        within(can.name, table, can.min_voltage, can.max_voltage, self._generator.table.points)
        self._volts = np.zeros(0)
        self._generator.load(table / self._gain, self._rate)
        self._volts = np.array(volts, dtype=float)
        self._lasts = table.size / self._rate

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Set up the oscilloscope to record `samples` samples of these inputs after the trigger. RigError for
        an unknown input or too many samples."""
        can = self.capabilities
        check_inputs(can, inputs, samples)
        read = [name for name in inputs if name in self._channels]
        shown = read or list(self._channels)[:1]  # at least one channel: its acquisition shows the run's end
        spans = {self._channels[name]: self._spans.get(name, _SPAN) for name in shown}
        self._oscilloscope.arm(spans, (samples + 1) / self._rate)
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Arm the oscilloscope, switch the output on and trigger the generator, whose sync output triggers
        the oscilloscope. RigError before `load` and `arm`, or if the oscilloscope does not get ready."""
        check_ready(self.capabilities, self._volts, self._samples)
        self._oscilloscope.start()
        self._generator.on()
        self._running, self._ends = True, time.monotonic() + self._lasts + 1.0
        self._generator.trigger()
        self._ends = time.monotonic() + self._lasts
        self._over = time.monotonic() + self._oscilloscope.length + _LATE

    def fetch(self) -> Array:
        """Return all samples [inputs, n], V, when the acquisition has ended; before, n is 0.

        Raises:
            RigError: no run is active, the acquisition does not end in time, a signal was out of range, or
                the recorded drive is another signal than the loaded one.
        """
        if not self._running:
            raise RigError(f"{self.capabilities.name}: nothing is running")
        if not self._oscilloscope.over():
            if time.monotonic() > self._over:
                raise RigError(
                    f"{self._oscilloscope.link.name}: its acquisition is not over, {_LATE:g} s after it "
                    "should be: does the generator's sync output trigger it?"
                )
            time.sleep(_POLL)
            return np.zeros((len(self._inputs), 0))
        # The table starts with one value of 0 V, so the drive starts one update after the trigger.
        times = np.arange(1, self._samples + 1) / self._rate
        played = held(self._volts, self._samples)
        read, channels = self._oscilloscope.read, self._channels
        rows = [read(channels[n], times) if n in channels else played for n in self._inputs]
        if "drive" in channels and "drive" in self._inputs:
            check_followed(self.capabilities.name, rows[self._inputs.index("drive")], played)
        return np.array(rows)

    def stop(self, slew: float) -> None:
        """Reduce the amplitude to 0 V at `slew` [V/s at the piezo], or await the end of the table if that is
        sooner. Then switch the output off and stop the oscilloscope.

        The output is switched off even if reducing the amplitude fails.
        """
        running, self._running = self._running, False
        try:
            if running:
                greatest = float(np.abs(self._volts).max(initial=0.0))
                fade_out(self._generator.fade, greatest, slew, self._ends)
        finally:
            self._generator.off()
            if running:
                self._oscilloscope.stop()

    def close(self) -> None:
        """Close both connections. A running table continues to its end, where it is at 0 V."""
        self._generator.link.close()
        self._oscilloscope.link.close()


registry.rigs.add(PairRig, "scpi")
