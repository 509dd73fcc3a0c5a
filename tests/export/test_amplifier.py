"""An export with an amplifier: its input, its rest, its limits, against the solver under a driven drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np
import pytest

import stickslip as ss
from export.building import SANITIZED, C, compiled, output, scan, walk
from stickslip.export import export_c, export_fmu
from stickslip.physics.electronics import Amplifier, driven
from stickslip.recording.chain import Chain

KANG = ss.load_actuator("kang2007")
FLOAT = [*SANITIZED, "-DSTICKSLIP_FLOAT"]


class Driven(NamedTuple):
    """An amplifier of random numbers and what it charges."""

    amplifier: Amplifier
    piezo_capacitance: float

    @classmethod
    def of(cls, seed: int) -> Driven:
        random = np.random.default_rng(seed)
        gain, offset = random.uniform(5.0, 25.0), random.uniform(-20.0, 40.0)
        bandwidth, slew = random.uniform(3e3, 2e4), random.uniform(2e5, 2e6)
        made = Amplifier(gain, offset, bandwidth, slew, 2.0, -10.0, random.uniform(90.0, 120.0))
        return cls(made, random.uniform(1e-7, 1e-6))

    def input(self, volts: Any) -> Any:
        """At which it comes to so many volts."""
        return (volts - self.amplifier.offset) / self.amplifier.gain


@pytest.mark.parametrize(("seed", "bandwidth"), [(0, None), (1, None), (2, None), (3, np.inf)])
def test_walk_begins_and_goes_as_the_solvers(seed: int, bandwidth: float | None, tmp_path: Path) -> None:
    """From a voltage at the piezo that is not the input's number; within 1 % of the walk, in float, too."""
    of, random = Driven.of(seed), np.random.default_rng(seed)
    of = of._replace(amplifier=of.amplifier._replace(bandwidth=bandwidth or of.amplifier.bandwidth))
    base, height = random.uniform(0.0, 25.0), random.uniform(30.0, 60.0)
    asked = ss.Sawtooth(height, 20.0, periods=4, offset=base)
    given = ss.Sawtooth(height / of.amplifier.gain, 20.0, periods=4, offset=of.input(base))
    drive = driven(of.amplifier, asked, of.piezo_capacitance, 0.2)
    truth = ss.simulate(KANG, drive, 0.2, sample_rate=1e3, tolerance=1e-9)
    for flags in ((), FLOAT):
        found = walk(KANG, tmp_path / f"{len(flags)}", *flags, waveform=given, **of._asdict())
        assert found["drive_voltage"][0] == pytest.approx(base, abs=1e-4)
        off = found["end_effector_position"] - truth.end_effector_position.values
        assert abs(off[0]) < 1e-12
        assert np.max(np.abs(off)) < 1e-2 * np.ptp(truth.end_effector_position.values)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_not_finite_keeps_the_last_input(seed: int, tmp_path: Path) -> None:
    """Also where the amplifier is only the slew rate of a chain."""
    of, random = Driven.of(seed), np.random.default_rng(seed)
    options = of._asdict() if seed % 2 else {"chain": Chain(slew_rate=1e5)}
    volts = random.uniform(10.0, 60.0, 300)
    inputs = of.input(volts) if seed % 2 else volts
    holes = np.flatnonzero(random.random(300) < 0.4)[5:]
    torn, kept = inputs.copy(), inputs.copy()
    torn[holes] = random.choice([np.nan, np.inf, -np.inf], holes.size)
    for k in holes:
        kept[k] = kept[k - 1]
    export_c(KANG, tmp_path / "c", **options)
    for flags in (SANITIZED, FLOAT):
        program = compiled(tmp_path / "c", C / "ticks.c", *flags)
        ran = [
            np.array(output(program, text=" ".join(map(repr, one.tolist()))).split(), dtype=float)
            for one in (torn, kept)
        ]
        first, second = (one.reshape(-1, 3) for one in ran)
        np.testing.assert_array_equal(first[:, :2], second[:, :2])
        assert np.flatnonzero(first[:, 2] == 2).tolist() == holes.tolist()
        assert np.ptp(second[:, 0]) > 1.0


@pytest.mark.parametrize("seed", range(3))
def test_feedforward_is_the_input_of_the_amplifier(seed: int, tmp_path: Path) -> None:
    """Played through it, in the solver, it moves the actuator as wanted but for the lag."""
    of = Driven.of(seed)
    of = of._replace(amplifier=of.amplifier._replace(bandwidth=2e4))
    motion = ss.Sine(1e-6, 5.0, -np.pi / 2, offset=4e-6, periods=2, unit="m")
    found = scan(KANG, tmp_path / "c", *FLOAT, motion=motion, **of._asdict())
    assert found["bits"].max() == 0
    volts = of.amplifier.gain * found["voltage"] + of.amplifier.offset
    drive = driven(of.amplifier, ss.Sampled(found["time"], volts), of.piezo_capacitance, 0.39)
    truth = ss.simulate(KANG, drive, times=found["time"][:390], tolerance=1e-9).end_effector_position.values
    lag = 1e-6 * 2 * np.pi * 5.0 * 50e-6  # the speed for 50 us
    for moved in (truth, found["end_effector_position"][:390]):
        assert np.max(np.abs(moved - found["wanted_position"][:390])) < lag + 2e-9


@pytest.mark.parametrize("highest", [80.0, 200.0])
def test_feedforward_is_cut_to_the_limits_of_both(highest: float, tmp_path: Path) -> None:
    """Of the amplifier, or of the actuator where its own are closer; the bit says so."""
    of = Driven.of(7)
    of = of._replace(amplifier=of.amplifier._replace(high=highest))
    most = min(highest, KANG.max_voltage)
    motion = ss.Sine(0.1 * KANG.gain * most, 5.0, offset=KANG.gain * most, periods=1, unit="m")
    found = scan(KANG, tmp_path / "c", motion=motion, **of._asdict())
    assert found["voltage"].max() == pytest.approx(of.input(most), rel=1e-9)
    assert found["bits"][-1] == 1


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmu_rests_at_a_constant_input(fmi: int, tmp_path: Path) -> None:
    of, volts = Driven.of(fmi), 60.0
    fmu = export_fmu(KANG, tmp_path / "fmu", fmi=fmi, **of._asdict())
    ran = fmpy.simulate_fmu(
        str(fmu), stop_time=0.01, output_interval=1e-4, start_values={"voltage": of.input(volts)},
        output=["drive_voltage", "end_effector_position"],
    )  # fmt: skip
    rest = ss.simulate(KANG, ss.Constant(volts), 1e-3).end_effector_position.values
    assert ran["drive_voltage"] == pytest.approx(volts, rel=1e-9)
    np.testing.assert_allclose(ran["end_effector_position"], rest[0], atol=1e-12)


def test_fmu_s_feedforward_is_the_input_of_the_amplifier(tmp_path: Path) -> None:
    of, wanted = Driven.of(5), {"wanted_position": 3e-6, "wanted_velocity": 1e-4}
    voltage = [
        fmpy.simulate_fmu(
            str(export_fmu(KANG, tmp_path / name, mode="feedforward", **options)),
            stop_time=1e-4, output_interval=1e-4, start_values=wanted, output=["voltage"],
        )["voltage"][-1]
        for name, options in (("bare", {}), ("behind", of._asdict()))
    ]  # fmt: skip
    assert voltage[1] == pytest.approx(of.input(voltage[0]), rel=1e-9)
