"""Virtual rig: the signal chain of a bench around the simulation of an actuator."""

from __future__ import annotations

import math
import threading
import time
import zlib

import numpy as np

from ..physics.actuator import Actuator
from ..physics.electronics import adc_output, amplifier_output, dac_output, filtered
from ..physics.temperature import at_temperature
from ..quantities import registry
from ..quantities.records import of_kind
from ..quantities.units import QuantityError
from ..simulation.drives import table_precision
from ..simulation.errors import SimulationError
from ..simulation.models import SLIDER, STAGE
from ..simulation.trajectory import COMPLETE, checked_tolerance, follow_model
from ..waveform.sampled import Sampled
from ..waveform.signal import Waveform
from .bench import Bench, Mounted
from .limits import LONGEST_STOP
from .protocols import About, Array, Capabilities, RigError
from .remanence import Remanence, annealed, from_state, left_by, remembers, simplified
from .streaming import Stream
from .variation import EXACT, Repeats

BLOCK = 0.02  # recorded time whose samples one `fetch` returns, s
OVERSAMPLING = 4  # rate at which analogue signals are computed, as a multiple of the sampling rate
# Column of a simulated trajectory that contains the position which a sensor measures, by the sensor's place.
_COLUMN = {"stage": STAGE, "end_effector": SLIDER}
_SETTLE = 1e-3  # time at 0 V after the ramp of a stop, in which the amplifier settles, s
MAX_POINTS = 5_000_000
MAX_STEPS = 5_000_000  # largest number of integration steps of a run; a run of 10 s takes some 200,000


class VirtualRig:
    """A simulated bench with its own amplifier, sensors and noise; see `protocols.Rig`.

    Args:
        actuator: the actuator that is driven.
        bench: the instruments.
        seed: seed of all noise. The same seed gives the same recording, bit for bit. Each run after the first
            has different noise.
        repeats: variation of the contact from run to run and from step to step; none by default.
        real_time: True to return samples no sooner than a real rig would.
        tolerance: greatest error of simulated positions, m (rad for a rotary actuator).

    Each run starts at rest, and its positions start at zero, as those of an incremental sensor. `origin` is
    the displacement of the end-effector by all earlier runs, m (rad). A piezo with hysteresis and creep,
    however, continues from its state at the end of the previous run, without a pause; the positions then
    start at the remaining stroke. The piezo of a new rig has rested at 0 V for long. To return to almost this
    state, run a sine about 0 V that decays over many periods, if the amplifier allows negative voltages. A
    run at 0 V is a rest. QuantityError if the sensors do not fit the actuator (m or rad).
    """

    simulated = True  # a simulated rig needs no arming
    about = About(
        device="none: the simulated bench of a laboratory",
        does="puts out and records",
        samples="as they come",
        safe_state="ramp to 0 V",
        verified="the tests of this package",
    )

    def __init__(
        self,
        actuator: Actuator,
        bench: Bench,
        *,
        seed: int = 0,
        repeats: Repeats = EXACT,
        real_time: bool = False,
        tolerance: float | str = 1e-9,
    ) -> None:
        tolerance = checked_tolerance(actuator, tolerance)
        of_kind(actuator, Actuator, "actuator")
        of_kind(bench, Bench, "bench")
        _check_sensors(actuator, bench)
        # The voltage limits of the actuator are removed. The gate checks the drive, and the simulation must
        # not refuse an output that is a step of the converter below 0 V.
        self.actuator = at_temperature(actuator, repeats.irregularity.temperature).replace(
            min_voltage=-math.inf, max_voltage=math.inf, piezo=simplified(actuator.piezo)
        )
        self._remanence: Remanence | None = None  # state of the piezo after the last run; None before any
        self.bench, self._seed, self._real_time, self._tolerance = bench, seed, real_time, tolerance
        self._repeats = repeats
        self._per_unit = bench.dac.gain * bench.amplifier.gain
        # Voltage at the piezo, V, for the number 0 sent to the D/A converter, as a program calibrates it.
        # Half a step is included, so that a truncating converter rounds to the nearest step.
        half = 0.5 * bench.dac.step * bench.amplifier.gain if bench.dac.truncates else 0.0
        self._offset = bench.amplifier.offset - half
        self._runs = 0
        self.origin = 0.0
        # Displacement of the end-effector relative to the stage at each sample of the run [n], m (rad).
        self._slid = np.zeros(0)
        self._volts = np.zeros(0)
        self._given: list[float] = []  # voltages so far of a run that is computed update by update, V
        self._inputs: tuple[str, ...] = ()
        self._samples = self._fetched = 0
        self._began = 0.0
        self._running = False
        self._interrupted = threading.Event()  # set by a stop: `fetch` then returns without waiting
        self._data = np.zeros((0, 0))
        self._stream: Stream | None = None  # the active run that is computed update by update
        self._turn = threading.Lock()  # prevents `stop` during an `exchange`, and the reverse
        # Numbers sent to the D/A converter in the last run and its ramp to 0 V, one per update [n].
        self._numbers = np.zeros(0)

    @property
    def capabilities(self) -> Capabilities:
        """Rates, ranges and inputs of the bench."""
        bench = self.bench
        dac, amplifier = bench.dac, bench.amplifier
        ends = amplifier.gain * np.array([dac.low, dac.high - dac.step]) + amplifier.offset
        return Capabilities(
            name=f"virtual rig {bench.name}",
            update_rate=dac.update_rate,
            sample_rate=bench.sample_rate,
            min_voltage=max(float(ends[0]), amplifier.low),
            max_voltage=min(float(ends[1]), amplifier.high),
            step=dac.step * amplifier.gain,
            max_points=MAX_POINTS,
            inputs={"drive": "V"} | {name: mounted.sensor.unit for name, mounted in bench.sensors.items()},
        )

    def told(self, runs: int) -> dict[str, str]:
        """Return the true contact in the next `runs` runs, as `Repeats.told`; empty if it does not vary."""
        return self._repeats.told(self.actuator, runs, self._runs)

    def load(self, volts: Array) -> None:
        """Load the drive [n], V at the piezo, one value per update. RigError while a run is active."""
        self._forbid_running("load")
        self._volts = np.array(volts, dtype=float)

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Choose the inputs of the next run, by name, and the number of samples to record. RigError if there
        is no such input, the number is too large or a run is active."""
        self._forbid_running("arm")
        known = self.capabilities.inputs
        for name in inputs:
            if name not in known:
                raise RigError(f"there is no input {name!r}; there are {', '.join(known)}")
        if not 0 < samples <= MAX_POINTS:
            raise RigError(f"{samples} samples are not 1 to {MAX_POINTS}")
        self._inputs, self._samples = tuple(inputs), samples

    def start(self) -> None:
        """Start a run: compute all its samples at once; `fetch` then returns them in blocks. Also count the
        run, on which the random variation depends. RigError before `load` and `arm`, during a run, or if the
        simulation fails."""
        self._forbid_running("start")
        if not self._volts.size or not self._samples:
            raise RigError("start needs a drive (load) and inputs (arm)")
        self._numbers = (self._volts - self._offset) / self._per_unit
        self._data = self._computed()
        self._runs += 1
        self._interrupted.clear()
        self._fetched, self._began, self._running = 0, time.monotonic(), True

    def begin(self, inputs: tuple[str, ...]) -> list[float]:
        """Start and count a run at 0 V whose output is set update by update, by `exchange`.

        Return the first readings of the inputs, in their order and units. RigError for an unknown input,
        during a run, or if bench or sensors do not allow such runs.
        """
        self._forbid_running("begin")
        self.arm(inputs, MAX_POINTS)
        actuator = self._here()
        seed = (self._seed, self._runs)
        stream = Stream(
            *(actuator, self.bench, inputs, seed, self._offset, self._per_unit, self._tolerance),
            self._remanence,
            self._repeats.slips(self.actuator, self._runs),
        )
        self._runs += 1
        self._given, self._stream, self._running = [], stream, True
        self._began = time.monotonic()
        return stream.readings()

    def exchange(self, volts: float) -> list[float]:
        """Output a voltage [V at the piezo] at this update; return the readings of the next update. RigError
        without a run, after `MAX_POINTS` updates, or if the simulation fails."""
        with self._turn:
            stream = self._stream
            if stream is None:
                raise RigError("nothing is running that takes its output update by update")
            if len(self._given) == MAX_POINTS:
                raise RigError(f"a run has {MAX_POINTS} updates at most")
            self._given.append(volts)
            if self._real_time:
                due = self._began + len(self._given) / self.bench.dac.update_rate
                time.sleep(max(0.0, due - time.monotonic()))
            try:
                return stream.exchange(volts)
            except SimulationError as error:
                raise RigError(f"the simulation of the actuator: {error}") from None

    def fetch(self) -> Array:
        """Return the next samples [inputs, n], in the inputs' units; n is 0 at the end of the run. RigError
        without a run."""
        if not self._running:
            raise RigError("nothing is running")
        end = min(self._fetched + max(1, round(BLOCK * self.bench.sample_rate)), self._samples)
        if self._real_time:
            due = self._began + end / self.bench.sample_rate
            if self._interrupted.wait(max(0.0, due - time.monotonic())):
                played = int((time.monotonic() - self._began) * self.bench.sample_rate)
                end = min(max(played, self._fetched), end)
        block = self._data[:, self._fetched : end]
        self._fetched = end
        return block

    def interrupt(self) -> None:
        """Let a waiting `fetch` return at once with the samples so far. Another thread calls this to stop."""
        self._interrupted.set()

    def stop(self, slew: float) -> None:
        """Ramp to 0 V at `slew` [V/s] from the output at the last fetched sample; end the run; update
        `origin`.

        The ramp takes `limits.LONGEST_STOP` seconds at most, even for a smaller `slew`. Without an active run
        nothing happens.
        """
        if not self._running:
            return
        if self._stream is not None:
            self._stop_stream(self._stream, slew)
            return
        if self._fetched and not self.actuator.clamped:  # in the ramp the end-effector sticks
            self.origin += float(self._slid[self._fetched - 1])
        rate = self.bench.dac.update_rate
        played = max(1, math.ceil(self._fetched * rate / self.bench.sample_rate))
        volts = _held(self._volts, played)
        ramp = self._ramp(float(volts[-1]), float(np.abs(self._volts).max()), slew)
        self._numbers = (np.append(volts, ramp) - self._offset) / self._per_unit
        self._running = False
        piezo = self.actuator.piezo
        if piezo is not None and remembers(piezo):
            given = Sampled(*self.output())
            table = given.drive(given.duration)
            self._remanence = left_by(piezo, self._begins(table.before), table, given.duration)

    def _ramp(self, volts: float, greatest: float, slew: float) -> Array:
        """Return the voltages [n], V, of the ramp from `volts` [V] to 0 V and of a pause of `_SETTLE` at 0 V.

        The slew rate is `slew` [V/s], or higher if a ramp from the peak voltage `greatest` [V] of the run
        would last longer than `LONGEST_STOP`. With an infinite `slew` the voltage jumps.
        """
        slew = max(slew, greatest / LONGEST_STOP) if math.isfinite(slew) else math.inf
        rate = self.bench.dac.update_rate
        updates = math.ceil(abs(volts) / slew * rate)
        ramp = volts * (1.0 - np.arange(1, updates + 1) / max(updates, 1))
        return np.append(ramp, np.zeros(math.ceil(_SETTLE * rate)))

    def _stop_stream(self, stream: Stream, slew: float) -> None:
        """End a run that is computed update by update: ramp to 0 V, store origin and state of the piezo."""
        with self._turn:
            self._stream = None  # from now on `exchange` refuses
            given = self._given or [0.0]
            ramp = self._ramp(given[-1], max(map(abs, given)), slew).tolist()
            try:
                for volts in ramp:
                    stream.exchange(volts)
            except SimulationError as error:
                raise RigError(f"the simulation of the actuator: {error}") from None
            finally:
                self._numbers = (np.array(given + ramp) - self._offset) / self._per_unit
                self._running = False
                self.origin += stream.slid
                self._remanence = stream.remanence

    def _begins(self, volts: float) -> Remanence:
        """Return the state of the piezo at the start of a run.

        Before the first run the piezo has rested for long at `volts` [V], which is the amplifier's output for
        a requested voltage of 0 V.
        """
        assert self.actuator.piezo is not None
        return self._remanence or annealed(self.actuator.piezo, volts)

    def output(self) -> tuple[Array, Array]:
        """Return the amplifier's output in the last run, with its ramp, as a piecewise linear signal.

        Returns:
            Times [n], s, and voltages [n], V; one point at 0 V before the first run.
        """
        dac, bench = self.bench.dac, self.bench
        if not self._numbers.size:
            return np.zeros(1), np.zeros(1)
        return amplifier_output(
            bench.amplifier, dac_output(dac, self._numbers), dac.update_rate, bench.piezo_capacitance
        )

    def monitor(self) -> float:
        """Return the amplifier's settled output after the last ramp, V, as rounded by the converter."""
        if not self._numbers.size:
            return 0.0
        code = float(dac_output(self.bench.dac, self._numbers[-1:])[0])
        return self.bench.amplifier.gain * code + self.bench.amplifier.offset

    def _forbid_running(self, what: str) -> None:
        if self._running:
            raise RigError(f"{what}: a run is going on; stop it first")

    def _computed(self) -> Array:
        """Simulate the run, store `_slid`, and return the samples of the chosen inputs [inputs, samples].
        RigError if the simulation fails."""
        bench, rate = self.bench, OVERSAMPLING * self.bench.sample_rate
        updates = math.ceil(self._samples * bench.dac.update_rate / bench.sample_rate) + 1
        codes = dac_output(bench.dac, _held(self._numbers, updates))
        monitor = bench.amplifier.gain * codes + bench.amplifier.offset
        times, volts = amplifier_output(
            bench.amplifier, codes, bench.dac.update_rate, bench.piezo_capacitance
        )
        sampled = np.arange(OVERSAMPLING * self._samples) / rate
        moved = follow_model(
            *self._driven(Sampled(times, volts), float(sampled[-1])),
            sampled,
            tolerance=self._tolerance,
            max_steps=MAX_STEPS,
        )
        if moved.outcome != COMPLETE:
            raise RigError(f"the simulation of the actuator {moved.outcome}")
        slips = self._repeats.slips(self.actuator, self._runs)
        if slips is not None:
            slid = moved.samples[:, SLIDER] - moved.samples[:, STAGE]
            moved.samples[:, SLIDER] += slips.follow(slid, np.full(slid.size, 1.0 / rate))
        at = moved.samples[::OVERSAMPLING]
        self._slid = at[:, SLIDER] - at[:, STAGE]
        rows = []
        for name in self._inputs:
            if name == "drive":
                update = np.arange(self._samples) * (bench.dac.update_rate / bench.sample_rate)
                rows.append(monitor[np.floor(update + 1e-9).astype(int)])
            else:
                mounted = bench.sensors[name]
                rows.append(self._sensed(name, mounted, moved.samples[:, _COLUMN[mounted.on]], rate))
        return np.array(rows).reshape(len(rows), self._samples)

    def _here(self) -> Actuator:
        """Return the actuator of this run.

        Its contact has the variation of the run. A normal force that depends on the position is shifted by
        the displacement of all earlier runs.
        """
        actuator = self._repeats.actuator(self.actuator, self._runs)
        if (along := actuator.normal_force) is None:
            return actuator
        return actuator.replace(normal_force=along._replace(origin=along.origin + self.origin))

    def _driven(self, drive: Waveform, end: float) -> tuple[Actuator, Waveform]:
        """Return the actuator of this run and its drive, for the simulation up to `end` [s].

        If the state of the piezo is kept between runs, hysteresis and creep are applied to the drive here,
        and the actuator is returned without its piezo. Otherwise the drive is unchanged.
        """
        actuator = self._here()
        piezo = actuator.piezo
        if piezo is None or not remembers(piezo):
            return actuator, drive
        table = drive.drive(end)
        at_piezo, _ = from_state(
            piezo, self._begins(table.before), table, end, table_precision(actuator, self._tolerance)
        )
        return actuator.replace(piezo=None), at_piezo

    def _sensed(self, name: str, mounted: Mounted, position: Array, rate: float) -> Array:
        random = np.random.default_rng([self._seed, self._runs, zlib.crc32(name.encode())])
        sensed = mounted.sensor.sense(position, rate, random)
        if mounted.adc is None:
            return sensed[::OVERSAMPLING]
        return adc_output(mounted.adc, filtered(self.bench.anti_alias, sensed, rate)[::OVERSAMPLING])


def _check_sensors(actuator: Actuator, bench: Bench) -> None:
    """Raise QuantityError for an angle sensor on a linear actuator, or a length sensor on a rotary one."""
    for name, mounted in bench.sensors.items():
        unit = mounted.sensor.unit
        if actuator.rotary and unit != "rad":
            raise QuantityError(
                f"the sensor {name!r} of the bench {bench.name} reads metres, but the actuator turns: it "
                "wants one that gives rad, as an Encoder does"
            )
        if unit == "rad" and not actuator.rotary:
            raise QuantityError(
                f"the sensor {name!r} of the bench {bench.name} gives rad: it is for an actuator with "
                "rotary = true"
            )


def _held(values: Array, count: int) -> Array:
    """Return the first `count` of these values [n]; if there are fewer, the last one is repeated."""
    return np.pad(values[:count], (0, max(0, count - values.size)), mode="edge")


registry.rigs.add(VirtualRig, "virtual")
