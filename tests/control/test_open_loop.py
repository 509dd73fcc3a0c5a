"""Steps of a motor from bursts, and a position without a sensor whose interval holds."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import xarray as xr
from benchmarks.open_loop import LEVEL, trial

import stickslip as ss
from stickslip.control import (
    Bursts,
    DeadReckoning,
    StepLaw,
    fit_steps,
    measure_steps,
    measure_travel,
    step_calibration,
)
from stickslip.quantities.units import QuantityError, to_si
from stickslip.rig import REGULAR, About, Irregularity, RigError, armed
from stickslip.rig.interlock import InterlockError
from stickslip.rig.positioner import Ranges
from stickslip.rig.twins import Stage
from stickslip.rig.twins.axis import steps

KANG = ss.load_actuator("kang2007")
LAW = StepLaw(
    (40.0, 60.0),
    (1e-6, 2e-6),
    (0.8e-6, 1.6e-6),
    (1e-9, 2e-9),
    (1e-9, 2e-9),
    100.0,
    scatter=0.05,
    common_drift=1e-4,
    reversal=0.2e-6,
    reversal_error=20e-9,
)


class Motor:
    """A positioner without a sensor around a twin's stage, in this process; it counts steps."""

    about: ClassVar[About] = About("a stage", "steps", "none", "0 V", "this test")

    def __init__(self, stage: Stage) -> None:
        self.simulated = True
        self.stage, self.count, self.stopped, self.met = stage, 0, 0, 0
        self.ranges = Ranges("motor", (0,), 100.0, 1.0, 1000.0, 100_000, sensor=False, scans=True)

    def step(self, axis: int, count: int, voltage: float | str, frequency: float | str) -> None:
        volts, hertz = to_si(voltage, "V", "voltage"), to_si(frequency, "Hz", "frequency")
        self.ranges.check(axis, count, volts, hertz)
        for piece in steps(self.stage, count, volts, hertz):
            self.stage.play(piece)
        self.met = self.stage.stop_met
        self.stage.rest(0.1)
        self.count += count

    def moving(self, axis: int) -> bool:
        return False

    def position(self, axis: int) -> float:
        return float(self.count)

    def scan(self, axis: int, voltage: float | str) -> None:
        self.stage.rest(0.01)

    def stop(self) -> None:
        self.stopped += 1

    def close(self) -> None:
        pass


def drawn(random: np.random.Generator, repeats: int) -> xr.Dataset:
    """Bursts of a motor that is drawn from the equations of `step_law`."""
    plan = list(Bursts((40.0, 60.0), steps=50, repeats=repeats).plan)
    own, common, rows = {1: 0.0, -1: 0.0}, 0.0, []
    for volts, way, turned in plan:
        size, gone = (1e-6 if volts < 50.0 else 2e-6) * (1.0 if way > 0 else 0.8), 0.0
        for _ in range(50):
            gone += size * (1.0 + common + own[way] + 0.05 * random.standard_normal())
            common += 1e-3 * random.standard_normal()
            own = {one: k + 3e-4 * random.standard_normal() for one, k in own.items()}
        rows.append(
            (volts, way, 50, way * (gone - 0.2e-6 * turned) + 14e-9 * random.standard_normal(), 14e-9, turned)
        )
    final = [
        (1e-6 if v < 50.0 else 2e-6) * f * (1.0 + common + own[w])
        for w, f in ((1, 1.0), (-1, 0.8))
        for v in (40.0, 60.0)
    ]
    names = ("voltage", "direction", "steps", "displacement", "noise", "after_reversal")
    made = {
        n: ("burst", np.array(c, dtype=float)) for n, c in zip(names, zip(*rows, strict=True), strict=True)
    }
    return xr.Dataset(made, attrs={"frequency": 100.0, "final": final})


def test_a_fit_finds_the_steps_as_they_are_at_the_end_and_their_noise() -> None:
    random, off, drifts, scatters = np.random.default_rng(3), [], [], []
    for _ in range(10):
        bursts = drawn(random, 4)
        law = fit_steps(bursts)
        found = np.array([*law.forward, *law.backward])
        off += ((found - bursts.attrs["final"]) / [*law.forward_errors, *law.backward_errors]).tolist()
        drifts.append(law.common_drift)
        scatters.append(math.hypot(law.scatter, law.threshold_scatter / np.mean(found)))
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.25  # the errors hold, and are not much too wide
    assert 0.8e-3 < np.median(drifts) < 2.5e-3  # the upper end of 1e-3
    assert 0.02 < np.median(scatters) < 0.09


def test_threshold_slope_and_tables(tmp_path: Path) -> None:
    volts, slope = (30.0, 40.0, 50.0, 60.0), 50e-9
    sizes = tuple(slope * (v - 22.0) for v in volts)
    law = StepLaw(volts, sizes, tuple(0.5 * s for s in sizes), (1e-9,) * 4, (1e-9,) * 4, 100.0)
    for direction, factor in ((1, 1.0), (-1, 0.5)):
        at, found = law.threshold(direction)
        assert at == pytest.approx(22.0)
        assert found == pytest.approx(factor * slope)
    table = law.equal_steps(5)
    for distance, up, down in table:
        assert law.size(up, 1) == pytest.approx(distance)
        assert law.size(down, -1) == pytest.approx(distance)
    assert law.table().forward == sizes
    law.save(tmp_path / "law.json")
    assert StepLaw.load(tmp_path / "law.json") == law
    law.save(tmp_path / "table.csv")
    head, *rows = (tmp_path / "table.csv").read_text().splitlines()
    assert head == "step_m,forward_V,backward_V"
    assert np.loadtxt(rows, delimiter=",") == pytest.approx(law.equal_steps(), rel=1e-5)


@pytest.mark.parametrize(
    ("forward", "backward", "voltage", "said"),
    [
        ((0.0, 0.0), (0.0, 0.0), 50.0, "no steps in both directions at 50 V"),
        ((0.0, 1e-6), (0.0, 0.0), 50.0, "no steps in a direction at 50 V"),
        # Steps that decrease to almost nothing at the upper voltage have no error there.
        ((1e-6, 1e-8), (1e-6, 1e-8), 60.0, "no steps in a direction at 60 V"),
    ],
)
def test_a_motor_that_makes_no_steps_has_no_model(
    forward: tuple[float, ...], backward: tuple[float, ...], voltage: float, said: str
) -> None:
    law = StepLaw((40.0, 60.0), forward, backward, (1e-9, 1e-9), (1e-9, 1e-9), 100.0)
    with pytest.raises(QuantityError, match=said):
        law.model(voltage)


def test_a_calibration_against_a_sensor_and_a_walk_without_it() -> None:
    stage = Stage(KANG, irregularity=Irregularity(), seed=4)
    motor, random, zero = Motor(stage), np.random.default_rng(1), stage.position
    bursts = Bursts((45.0, 60.0), steps=20, repeats=3, settle=0.0)
    made = measure_steps(
        motor, 0, lambda: stage.position + 50e-9 * random.standard_normal(), bursts, noise=50e-9
    )
    assert motor.stopped == 1
    law = fit_steps(made)
    ratio = law.size(60.0, 1) / law.size(60.0, -1)
    assert 1.2 < ratio < 1.36  # 1.28 in slips
    axis = DeadReckoning(motor, 0, law, stage.position, 50e-9)
    assert zero != stage.position
    axis.step(150)
    axis.step(-60)
    low, high = axis.interval()
    assert low < stage.position < high
    assert high - low < 0.2 * abs(axis.position - zero)
    assert axis.tally == (150, 60, 1)
    low, high = axis.go(axis.position + 50e-6)
    assert low < stage.position < high
    axis.datum(stage.position, 50e-9)
    assert axis.error < 51e-9
    assert axis.tally == (0, 0, 0)


def test_a_calibration_from_limit_to_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(KANG, travel=200e-6, irregularity=REGULAR._replace(direction=0.28), seed=4)
    motor = Motor(stage)
    bursts = Bursts((60.0, 70.0, 80.0), steps=4, repeats=3, settle=0.0)
    made = measure_travel(motor, 0, lambda: motor.met, 200e-6, bursts)
    law = fit_steps(made)
    free = Motor(Stage(KANG, irregularity=REGULAR._replace(direction=0.28), seed=4))
    for k, volts in enumerate(bursts.voltages):
        for direction, errors in ((1, law.forward_errors), (-1, law.backward_errors)):
            free.step(0, 4 * direction, volts, 100.0)
            before = free.stage.position
            for _ in range(5):  # bursts as those of the calibration: the first step of each goes short
                free.step(0, 4 * direction, volts, 100.0)
            size = abs(free.stage.position - before) / 20
            assert abs(law.size(volts, direction) - size) < 3.0 * errors[k] + 0.02 * size
    monkeypatch.setattr(step_calibration, "_MOST_STEPS", 20)
    with pytest.raises(RigError, match="the lower limit is not reached after 24 steps of 80 V"):
        measure_travel(free, 0, lambda: 0, 200e-6, bursts)


def test_doubts_are_said_and_widen_the_interval_until_a_datum() -> None:
    motor = Motor(Stage(KANG, seed=1))
    axis = DeadReckoning(motor, 0, LAW)
    assert axis.interval() == (-math.inf, math.inf)
    with pytest.raises(QuantityError, match="give a datum first"):
        axis.go(0.0)
    for act, words in (
        (lambda: axis.step(3, 70.0), "3 steps of 70 V, which was not calibrated"),
        (lambda: axis.step(3, 60.0, 200.0), "3 steps at 200 Hz, calibrated at 100 Hz"),
        (lambda: axis.held(20.0), "held at 20 V"),
        (lambda: (setattr(motor, "count", motor.count + 7), axis.step(1)), r"\+7 steps by others"),
    ):
        axis.datum(0.0, 1e-9)
        assert not axis.doubt
        act()
        assert re.search(words, axis.doubt), axis.doubt
        assert axis.error > 1e-6
    with pytest.raises(QuantityError, match="was not calibrated: 40 to 60 V were"):
        DeadReckoning(motor, 0, LAW, voltage=80.0)


def test_what_cannot_be_fitted_is_refused() -> None:
    bursts = drawn(np.random.default_rng(1), 3)
    for wrong, words in (
        (bursts.drop_vars("noise"), "have no noise"),
        (bursts.isel(burst=slice(0, 9)), "too few for 2 voltages"),
        (bursts.where(bursts.direction > 0, drop=True), "no burst backward at 40 V"),
        (bursts.assign(displacement=bursts.displacement * math.nan), "not finite"),
    ):
        with pytest.raises(QuantityError, match=words):
            fit_steps(wrong)
    with pytest.raises(QuantityError, match="whole number"):
        Bursts((40.0,), steps=1.5)
    with pytest.raises(QuantityError, match="different ones"):
        Bursts((40.0, 40.0))


def test_the_interval_of_random_motors_holds_as_often_as_it_says() -> None:
    """Three of the study's 400 motors; of 24 intervals of 95 % fewer than 20 hold with a probability of 0.3
    %."""
    off = np.abs([trial(seed).off for seed in range(3)])
    assert LEVEL == 0.95
    assert int((off <= 1.0).sum()) >= 20


def test_what_moves_a_motor_by_itself_must_be_armed() -> None:
    motor = Motor(Stage(KANG))
    motor.simulated = False
    bursts, axis = Bursts((45.0, 60.0), steps=2, repeats=1), DeadReckoning(motor, 0, LAW, 0.0, 1e-7)
    for act in (
        lambda: measure_steps(motor, 0, lambda: 0.0, bursts, noise=50e-9),
        lambda: measure_travel(motor, 0, lambda: 0, 1e-3, bursts),
        lambda: axis.step(1),
        lambda: axis.held(10.0),
    ):
        with pytest.raises(InterlockError, match="motor: the output is not armed"):
            act()
    assert motor.count == 0
    with armed("a test"):
        axis.step(1)
    assert motor.count == 1
