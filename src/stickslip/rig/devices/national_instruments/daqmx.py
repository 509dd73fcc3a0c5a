"""A DAQ card of National Instruments as a rig: analogue output and inputs on one clock, through NI-DAQmx.

The card's output goes to an amplifier of known gain, which drives the piezo; sensors go to the inputs. The
inputs' sample clock also clocks the output, so both start with the same sample.
"""

from __future__ import annotations

import importlib
import json
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from ....quantities import registry
from ....quantities.units import QuantityError, to_si
from ...limits import LONGEST_STOP
from ...protocols import About, Array, Capabilities, RigError

_POLL = 0.01  # pause of `fetch` if no new samples have arrived, s
_EDGE = 0.02  # duration of the output's jump to a new value, as a fraction of the update interval (assumed)
_MOST = 5_000_000  # largest number of updates of a drive and of samples of a recording


class DaqmxRig:
    """A data acquisition card of National Instruments through the library nidaqmx, as a `protocols.Rig`.

    Args:
        device: name of the card in NI-DAQmx, such as "Dev1".
        gain: gain of the amplifier, V at the piezo per V at the card.
        inputs: analogue input of the card by name of the rig's input, such as {"gauge": "ai0"}, all in V. The
            rig also has an input "drive": the loaded drive, unless an analogue input has this name.
        output: analogue output of the card that drives the amplifier.
        rate: update rate of the output and sampling rate of the inputs, Hz.
        low, high: voltage range of the card's output and inputs, V.

    Raises:
        RigError: nidaqmx or its driver is not installed, or there is no such device.
        QuantityError: a value is out of range, or there are no inputs.
    """

    about = About(
        device="National Instruments, any card with clocked analogue output (NI-DAQmx)",
        does="puts out and records",
        samples="as they come, on one clock with the output",
        safe_state="ramp to 0 V; without the program the card keeps its last voltage",
        verified="the library nidaqmx 1.7 above a simulated driver; not run on hardware",
    )

    @staticmethod
    def attached() -> list[tuple[str, str]]:
        """Return (name, model) of each card that NI-DAQmx knows on this machine.

        An ImportError, or an error of the driver, is raised if NI-DAQmx is not installed.
        """
        system = importlib.import_module("nidaqmx.system").System.local()
        return [(device.name, device.product_type) for device in system.devices]

    def __init__(
        self,
        device: str,
        *,
        gain: float,
        inputs: Mapping[str, str],
        output: str = "ao0",
        rate: float | str = 20e3,
        low: float | str = -10.0,
        high: float | str = 10.0,
    ) -> None:
        rate, low, high = to_si(rate, "Hz", "rate"), to_si(low, "V", "low"), to_si(high, "V", "high")
        if not (math.isfinite(gain) and gain > 0.0 and rate > 0.0 and low < high):
            raise QuantityError(
                f"gain = {gain}, rate = {rate:g} Hz, low = {low:g} V, high = {high:g} V cannot be"
            )
        if not inputs:
            raise QuantityError('inputs: name one analogue input at least, such as {"gauge": "ai0"}')
        try:
            self._library: Any = importlib.import_module("nidaqmx")
            self._constants: Any = importlib.import_module("nidaqmx.constants")
        except ModuleNotFoundError:
            raise RigError("a card of National Instruments needs nidaqmx: pip install nidaqmx") from None
        self._device, self._gain, self._range = device, gain, (low, high)
        self._channels, self._output, self._rate = dict(inputs), output, rate
        self._volts: Array = np.zeros(0)
        self._inputs: tuple[str, ...] = ()
        self._samples = self._done = 0
        self._tasks: list[Any] = []
        self._started = False
        with self._told("is there"):
            system = importlib.import_module("nidaqmx.system")
            card, driver = system.Device(device), system.System.local().driver_version
            self._card = {"device": str(card.product_type), "serial": f"{int(card.serial_num):08X}"}
            self._card["driver"] = "NI-DAQmx " + ".".join(str(part) for part in driver)
        self.capabilities = Capabilities(
            name=f"NI-DAQmx {device} ({self._card['device']})",
            update_rate=rate,
            sample_rate=rate,
            min_voltage=gain * low,
            max_voltage=gain * high,
            step=gain * (high - low) / 65536,
            max_points=_MOST,
            inputs={"drive": "V", **dict.fromkeys(self._channels, "V")},
        )

    def told(self, runs: int) -> dict[str, str]:
        """Return attributes of a recording, whatever its number of `runs`: "device", a JSON text with card,
        driver, wiring and settings."""
        del runs
        low, high = self._range
        settings = {"name": self._device, "gain": self._gain, "low": low, "high": high, "rate": self._rate}
        wiring = {"output": self._output, "inputs": self._channels}
        return {"device": json.dumps({**self._card, **settings, **wiring})}

    def load(self, volts: Array) -> None:
        """Check and keep the drive [n], V at the piezo, one value per update, for the next `start`.

        Raises:
            RigError: the drive is too long, not finite, or outside the card's voltage range.
        """
        if volts.size > _MOST or not np.all(np.isfinite(volts)):
            raise RigError(f"{self._device}: the drive must be up to {_MOST} finite voltages")
        asked = volts / self._gain
        if float(asked.min()) < self._range[0] - 1e-9 or float(asked.max()) > self._range[1] + 1e-9:
            raise RigError(
                f"{self._device}: the drive is not within {self._range[0]:g} to {self._range[1]:g} V"
            )
        self._volts = np.array(volts, dtype=float)

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Choose the inputs and the number of samples of each that the next `start` records. RigError if the
        rig has no such input or too many samples are requested."""
        for name in inputs:
            if name not in self.capabilities.inputs:
                known = ", ".join(self.capabilities.inputs)
                raise RigError(f"{self._device}: there is no input {name!r}; there are {known}")
        if not 1 <= samples <= _MOST:
            raise RigError(f"{self._device}: {samples} samples are not 1 to {_MOST}")
        self._inputs, self._samples = inputs, samples

    def start(self) -> None:
        """Start the output, which waits for the sample clock of the inputs; then start the inputs and with
        them the output. RigError before `load` and `arm`, for a drive of one value, or if the driver
        refuses."""
        if self._volts.size < 2 or not self._samples:
            raise RigError(f"{self._device}: start needs a drive (load) and inputs (arm)")
        self._end()
        finite, (low, high) = self._constants.AcquisitionType.FINITE, self._range
        with self._told("start"):
            recorder, output = self._new(), self._new()
            for name in dict.fromkeys(self._measured() or self._channels):
                recorder.ai_channels.add_ai_voltage_chan(
                    f"{self._device}/{self._channels[name]}", min_val=low, max_val=high
                )
            recorder.timing.cfg_samp_clk_timing(self._rate, sample_mode=finite, samps_per_chan=self._samples)
            output.ao_channels.add_ao_voltage_chan(
                f"{self._device}/{self._output}", min_val=low, max_val=high
            )
            clock = f"/{self._device}/ai/SampleClock"
            count = self._volts.size
            output.timing.cfg_samp_clk_timing(
                self._rate, source=clock, sample_mode=finite, samps_per_chan=count
            )
            output.write(self._volts / self._gain, auto_start=False)
            output.start()
            recorder.start()
        self._done, self._started = 0, True

    def fetch(self) -> Array:
        """Return the samples [inputs, n], V, that arrived since the last call; n may be 0.

        RigError if no run is active or the driver reports an error.
        """
        if not self._started:
            raise RigError(f"{self._device}: nothing is running")
        with self._told("read"):
            recorder = self._tasks[0]
            count = min(int(recorder.in_stream.avail_samp_per_chan), self._samples - self._done)
            if count <= 0:
                time.sleep(_POLL)
                return np.zeros((len(self._inputs), 0))
            found = np.array(recorder.read(number_of_samples_per_channel=count)).reshape(-1, count)
        rows = dict(zip(self._measured() or self._channels, found, strict=False))
        index = np.minimum(np.arange(self._done, self._done + count), self._volts.size - 1)
        self._done += count
        return np.array([rows[name] if name in rows else self._volts[index] for name in self._inputs])

    def stop(self, slew: float) -> None:
        """Ramp the output from its present voltage to 0 V at `slew` [V/s at the piezo], timed by the card.

        Without an active run, only the NI-DAQmx tasks are closed.

        Raises:
            RigError: the ramp failed; the card may keep its last voltage.
        """
        if not self._started:
            self._end()
            return
        try:
            with self._told("stop"):
                self._ramp(slew)
        except RigError as error:
            raise RigError(f"{error}; the card may keep its last voltage") from None
        finally:
            self._end()

    def output(self) -> tuple[Array, Array]:
        """Return the output waveform of the loaded drive, piecewise linear: times [s] from the start, and
        voltages [V] at the piezo.

        The output is constant during an update. A new value is assumed to be reached within 2 % of the
        update interval (not measured on a card).
        """
        tick = 1.0 / self._rate
        begins: Array = np.arange(self._volts.size, dtype=np.float64) * tick
        times: Array = np.stack([begins + _EDGE * tick, begins + tick], axis=1).ravel()
        return np.append(0.0, times), np.append(0.0, np.repeat(self._volts, 2))

    def close(self) -> None:
        """Close the NI-DAQmx tasks. The card keeps its last voltage."""
        self._end()

    def _ramp(self, slew: float) -> None:
        """Ramp from the last voltage that was put out to 0 V at `slew` [V/s at the piezo], and wait for the
        end. The slew rate is raised if a ramp over the whole range would last longer than `LONGEST_STOP`."""
        played = int(self._tasks[1].out_stream.total_samp_per_chan_generated)
        self._end()
        if not played:
            return
        begin = float(self._volts[min(played, self._volts.size) - 1])
        slew = max(slew, max(abs(self._gain * one) for one in self._range) / LONGEST_STOP)
        count = max(math.ceil(abs(begin) / slew * self._rate), 2) if math.isfinite(slew) else 2
        output, (low, high) = self._new(), self._range
        output.ao_channels.add_ao_voltage_chan(f"{self._device}/{self._output}", min_val=low, max_val=high)
        finite = self._constants.AcquisitionType.FINITE
        output.timing.cfg_samp_clk_timing(self._rate, sample_mode=finite, samps_per_chan=count)
        output.write(begin / self._gain * (1.0 - np.arange(1, count + 1) / count), auto_start=False)
        output.start()
        output.wait_until_done(timeout=LONGEST_STOP + 5.0)

    def _measured(self) -> list[str]:
        return [name for name in self._inputs if name in self._channels]

    def _new(self) -> Any:
        task = self._library.Task()
        self._tasks.append(task)
        return task

    def _end(self) -> None:
        for task in self._tasks:
            with suppress(self._library.DaqError):
                task.close()
        self._tasks, self._started = [], False

    def _told(self, what: str) -> _Told:
        return _Told(self._device, what, self._library)


class _Told:
    """Context manager that turns errors of the library nidaqmx into RigError.

    The message names the device and the action `what`. `library` is the imported module nidaqmx.
    """

    def __init__(self, device: str, what: str, library: Any) -> None:
        self._device, self._what, self._library = device, what, library

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        failures = (self._library.DaqError, self._library.errors.Error, OSError)
        if isinstance(error, failures):
            raise RigError(f"{self._device}: {self._what}: {error}") from None


registry.rigs.add(DaqmxRig, "daqmx")
