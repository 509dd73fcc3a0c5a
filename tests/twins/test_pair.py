"""A generator and an oscilloscope as a rig, by the commands of each family; what goes wrong with either."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import stickslip as ss
from stickslip.quantities.units import QuantityError
from stickslip.rig import LimitError, RigError
from stickslip.rig.attached import probe
from stickslip.rig.devices.scpi import PairRig
from stickslip.rig.devices.scpi.twin_generator import GeneratorTwin
from stickslip.rig.devices.scpi.twin_oscilloscope import OscilloscopeTwin
from stickslip.rig.devices.scpi.twin_wiring import Wiring
from stickslip.rig.twins.scpi import shortened

from .serving import served
from .wired import CAPTURE, CHANNELS, DRIVE, LIMITS, deviation, wiring

# Of the sensor: m of a step of the oscilloscope, by its bits; and of the jump, which takes 2 us.
STEP = {"infiniivision": 4 * 2e-5 / 4096, "mso5000": 4 * 2e-5 / 256, "dpo3000": 4 * 2e-5 / 4096}
JUMP = 12e-9
OPTIONS: dict[str, Any] = {
    "gain": 15.0,
    "inputs": {"gauge": 2, "monitor": 1},
    "spans": {"gauge": "4 V", "monitor": "12 V"},
    "rate": "10 kHz",
    "timeout": "30 s",
}


class Bench:
    """Both twins, and the rig on them; `heard` is what the generator was told."""

    def __init__(self, generator: str = "33500", oscilloscope: str = "infiniivision") -> None:
        self.wiring: Wiring = wiring()
        self.generator = GeneratorTwin(self.wiring, generator)
        self.oscilloscope = OscilloscopeTwin(self.wiring, oscilloscope)
        self.heard: list[str] = []
        inner = self.generator.execute

        def execute(text: str, block: bytes = b"") -> bytes:
            self.heard.append(text)
            return inner(text, block)

        self.generator.execute = execute  # type: ignore[method-assign]

    @contextmanager
    def rig(self, **changes: Any) -> Iterator[PairRig]:
        with served(self.generator) as first, served(self.oscilloscope) as second:
            made = PairRig(f"127.0.0.1:{first}", f"127.0.0.1:{second}", **{**OPTIONS, **changes})
            try:
                yield made
            finally:
                made.close()

    def at_rest(self) -> bool:
        """Whether the piezo comes to 0 V."""
        end = time.monotonic() + 60.0
        while self.wiring.voltage != 0.0 and time.monotonic() < end:
            time.sleep(0.02)
        time.sleep(0.05)
        return self.wiring.voltage == 0.0


@pytest.mark.parametrize(
    ("generator", "oscilloscope"),
    [("33500", "infiniivision"), ("dg1000z", "mso5000"), ("33500", "dpo3000")],
)
def test_a_pair_records_what_the_plant_does(generator: str, oscilloscope: str) -> None:
    bench = Bench(generator, oscilloscope)
    with bench.rig() as rig:
        recording = ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)
        assert deviation(recording) < JUMP + 0.5 * STEP[oscilloscope]
        assert float(recording.end_effector_position[-1]) > 6e-6
        seen, asked = 15.0 * recording.monitor.values, recording.drive_voltage.values
        assert np.abs(seen[asked > 1.0] - asked[asked > 1.0]).max() < 12.0 / 256 * 15.0
        assert bench.generator.identity in recording.attrs["device"]
        assert not bench.generator.on
        assert bench.at_rest()


def test_a_drive_through_visa_that_does_not_end_at_zero_is_brought_there() -> None:
    bench = Bench()
    with served(bench.generator) as first, served(bench.oscilloscope) as second:
        where = [f"TCPIP::127.0.0.1::{port}::SOCKET" for port in (first, second)]
        rig = PairRig(*where, **{**OPTIONS, "ramp": "500 V/s"})
        recording = ss.rig.measure(rig, ss.Step("60 V"), CHANNELS, CAPTURE, LIMITS)
        assert recording.monitor.values[-1] * 15.0 == pytest.approx(60.0, abs=0.05)
        assert bench.at_rest()
        table = 15.0 * 0.5 * 8.0 * bench.generator._table  # V at the piezo: 8 V from peak to peak
        assert table[0] == table[-1] == 0.0
        assert table.max() == pytest.approx(60.0)
        assert np.count_nonzero(np.diff(table) < 0.0) / 1e4 == pytest.approx(60.0 / 500.0, abs=1e-4)
        with pytest.raises(LimitError, match="ramp of 500 V/s, faster than the greatest slew of 400 V/s"):
            ss.rig.measure(
                rig, ss.waveform.Ramp("300 V/s"), CHANNELS, CAPTURE,
                ss.rig.Limits(max_voltage="100 V", max_slew="400 V/s", stop_slew="400 V/s"),
            )  # fmt: skip
        rig.close()


def test_limits_hold_before_anything_is_uploaded() -> None:
    bench = Bench()
    with bench.rig() as rig:
        bench.heard.clear()
        with pytest.raises(LimitError, match="above the greatest voltage of 100 V"):
            ss.rig.measure(rig, ss.Step("120 V"), CHANNELS, CAPTURE, LIMITS)
        with pytest.raises(RigError, match="within -150 to 150 V"):
            rig.load(np.full(9, 151.0))
        with pytest.raises(RigError, match="there is no input 'nose'"):
            rig.arm(("nose",), 10)
        assert bench.heard == []
        with pytest.raises(RigError, match=r'SOUR1:VOLT 50: -222,"Data out of range"'):
            rig._generator.link.do("SOUR1:VOLT 50")
        rig._generator.link.do("SOUR1:VOLT 5")  # the queue is empty again
    with pytest.raises(QuantityError, match="gain = -3"), bench.rig(gain=-3.0):
        pass
    with pytest.raises(QuantityError, match=r"spans\.gauge.*'3 kg'"), bench.rig(spans={"gauge": "3 kg"}):
        pass


def test_a_stop_in_mid_run_fades_to_zero() -> None:
    bench = Bench()
    long = ss.rig.Capture(length="2 s", interval="1 ms")
    position = {"end_effector_position": CHANNELS["end_effector_position"]}
    with bench.rig() as rig:
        plan = ss.rig.measurement.plan_run(rig.capabilities, ss.Step("90 V"), position, long, LIMITS)
        rig.load(plan.volts)
        rig.arm(("gauge",), plan.samples)
        rig.start()
        while bench.wiring.voltage < 89.0:
            time.sleep(0.01)
        began = time.monotonic()
        rig.stop(300.0)
        took = time.monotonic() - began
        amplitudes = [float(text.split()[1]) for text in bench.heard if text.startswith("SOUR1:VOLT ")][1:]
        assert 90.0 / 300.0 <= took < 10.0
        assert len(amplitudes) > 10
        assert np.all(np.diff(amplitudes) < 0.0)
        assert np.ptp(np.diff(amplitudes[:-1])) < 1e-3  # even steps
        assert bench.heard[-2:] == ["OUTP1 OFF", "SYST:ERR?"]
        assert bench.at_rest()


@pytest.mark.parametrize(
    ("cable", "said"),
    [
        ("sync", "does the generator's sync output trigger it"),
        ("sensor", "the input 'gauge' is frozen"),
        ("output", "the input 'gauge' is frozen"),
    ],
)
def test_a_cable_that_is_out_is_told(cable: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if cable == "sync":
        monkeypatch.setattr("stickslip.rig.devices.scpi.pair._LATE", 0.1)
    bench = Bench()
    bench.wiring.cables.discard(cable)
    with bench.rig() as rig, pytest.raises(RigError, match=said):
        ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)
    assert bench.at_rest()


def broken(
    answer: Callable[[str, bytes], bytes], monkeypatch: pytest.MonkeyPatch, device: Any, query: str
) -> None:
    """Whatever the device says to this query goes through `answer`."""
    inner = device.execute

    def execute(text: str, block: bytes = b"") -> bytes:
        said = inner(text, block)
        return answer(text, said) if text.strip() == query else said

    monkeypatch.setattr(device, "execute", execute)


GIVEN_UP = threading.Event()


def late(text: str, said: bytes) -> bytes:
    GIVEN_UP.wait(60.0)
    return said


@pytest.mark.parametrize(
    ("which", "query", "answer", "said"),
    [
        ("oscilloscope", ":WAV:PRE?", lambda text, said: b"\x00\xff,nonsense\n", r"WAV:PRE\? is answered by"),
        ("oscilloscope", ":WAV:PRE?", lambda text, said: said.replace(b"E-", b"E+"), "are asked for"),
        ("oscilloscope", ":WAV:DATA?", lambda text, said: b"garbage\n", "no block"),
        ("oscilloscope", ":WAV:DATA?", lambda text, said: said[:900], "only"),
        ("oscilloscope", ":WAV:DATA?", lambda text, said: b"#9999999999", "no block"),
        ("oscilloscope", ":OPER:COND?", lambda text, said: b"maybe\n", r"COND\? is answered by 'maybe'"),
        ("oscilloscope", ":WAV:PRE?", late, r"nothing came as the answer to ':WAV:PRE\?'"),
        ("generator", "SYST:ERR?", lambda text, said: b"hello\n", r"SYST:ERR\?: 'hello' came, late"),
        ("generator", "SYST:ERR?", late, r"nothing came as the answer to 'SYST:ERR\?'"),
    ],
)  # fmt: skip
def test_garbage_and_late_answers_are_told_and_the_output_is_off(
    which: str, query: str, answer: Any, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench()
    GIVEN_UP.clear()
    timeout = (
        "2 s" if answer is late else "5 s" if said == "only" else "30 s"
    )  # a block that is cut is waited for
    with bench.rig(timeout=timeout) as rig:
        broken(answer, monkeypatch, getattr(bench, which), query)
        with pytest.raises(RigError, match=f"{which} at 127.0.0.1:\\d+.*{said}"):
            ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)
        GIVEN_UP.set()
        end = time.monotonic() + 60.0
        while bench.generator.on and time.monotonic() < end:  # what the client told is still to be done
            time.sleep(0.02)
        assert not bench.generator.on
        assert bench.at_rest()


def test_who_is_somebody_else_is_told() -> None:
    bench = Bench()
    with (
        served(bench.generator) as first,
        served(bench.oscilloscope) as second,
        pytest.raises(RigError, match=r"generator at \S+ says it is 'AGILENT.*known are Keysight 33500"),
    ):
        PairRig(f"127.0.0.1:{second}", f"127.0.0.1:{first}", **OPTIONS)
    with (
        served(bench.generator) as first,
        served(GeneratorTwin(bench.wiring, "dg1000z")) as second,
        pytest.raises(RigError, match=r"oscilloscope at \S+ says it is 'Rigol.*known are Keysight Inf"),
    ):
        PairRig(f"127.0.0.1:{first}", f"127.0.0.1:{second}", **OPTIONS)
    with pytest.raises(RigError, match=r"generator at 127\.0\.0\.1:1 cannot be reached"):
        PairRig("127.0.0.1:1", "127.0.0.1:1", **OPTIONS)
    with pytest.raises(RigError, match=r"generator at TCPIP::127\.0\.0\.1::1::SOCKET.*refused"):
        PairRig("TCPIP::127.0.0.1::1::SOCKET", "127.0.0.1:1", **OPTIONS)


def test_an_instrument_is_found_at_an_address() -> None:
    with served(Bench().oscilloscope) as port:
        (found,) = probe("127.0.0.1", port)
    assert found == (f"127.0.0.1:{port}", "AGILENT TECHNOLOGIES,DSO-X 3024A,MY50000001,02.50", "scpi")


def test_a_program_that_is_gone_leaves_zero_volts() -> None:
    """A table is put out once, and ends at 0 V."""
    bench = Bench()
    with bench.rig() as rig:
        rig.load(np.full(500, 80.0))
        rig.arm(("gauge",), 500)
        rig.start()
    assert bench.at_rest()
    assert bench.generator.on


def test_a_signal_beyond_the_screen_is_told() -> None:
    bench = Bench()
    beyond = pytest.raises(RigError, match="channel 2 was beyond what it shows")
    with bench.rig(spans={"gauge": "0.5 V", "monitor": "12 V"}) as rig, beyond:
        ss.rig.measure(rig, DRIVE, CHANNELS, CAPTURE, LIMITS)


def test_headers_in_long_form() -> None:
    assert shortened(":CHANnel2:RANGe?") == ("CHAN:RANG?", 2)
    assert shortened("SYSTem:ERRor?") == ("SYST:ERR?", 1)
    assert shortened(":waveform:points:mode") == ("WAV:POIN:MODE", 1)
    assert shortened(":SOURce1:TRACe:DATA:DAC16") == ("SOUR:TRAC:DATA:DAC16", 1)
