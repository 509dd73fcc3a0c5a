"""What the rig says while it runs: readings that fail stop it, and what was recorded is kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip.recording import open_recording
from stickslip.rig import Capture, Home, LimitError, Limits, RigError, VirtualRig, measure
from stickslip.waveform.periodic import ReverseSawtooth, Sawtooth
from stickslip.waveform.shapes import Step

from rig.laboratory import ACTUATOR, BENCH, CHANNELS, IDEAL  # isort: skip

WALK = Sawtooth(65.0, 20.0)
CAPTURE = Capture(1.0, 1e-3, 0.02)


class Failing(VirtualRig):
    """A rig whose readings change from a sample on."""

    def __init__(self, begin: int, change: Callable[[np.ndarray], np.ndarray], only: str = "ideal") -> None:
        super().__init__(ACTUATOR, BENCH)
        self._begin, self._change, self._only, self.given = begin, change, only, 0

    def fetch(self) -> np.ndarray:
        block = super().fetch().copy()
        row = self._inputs.index(self._only)
        at = max(self._begin - self.given, 0)
        if at < block.shape[1]:
            block[row, at:] = self._change(block[row, at:])
        self.given += block.shape[1]
        return block


@settings(max_examples=30)
@given(begin=st.integers(0, 19_000), value=st.sampled_from([np.nan, np.inf, -np.inf]))
def test_a_reading_that_is_no_number_stops_at_once_and_the_rest_is_kept(begin: int, value: float) -> None:
    rig = Failing(begin, lambda seen: np.full_like(seen, value))
    with pytest.raises(LimitError, match=rf"'ideal' reads {value} at sample {begin}") as caught:
        measure(rig, WALK, IDEAL, CAPTURE, Limits(max_position=1e-3))
    assert rig.given <= begin + 400, "no block more than the one in which it failed"
    assert abs(rig.output()[1][-1]) <= rig.capabilities.step
    kept = caught.value.recording  # type: ignore[attr-defined]
    if begin < 40:
        return
    assert "reads" in kept.attrs["outcome"]
    whole = measure(VirtualRig(ACTUATOR, BENCH), WALK, IDEAL, CAPTURE, Limits())
    assert whole.attrs["outcome"] == "complete"
    if begin > 1000:  # what comes before is settling and pre-trigger
        count = kept.sizes["time"]
        assert count == pytest.approx((begin - 200) / 20, abs=1.0)
        np.testing.assert_array_equal(kept["drive_voltage"], whole["drive_voltage"][:count])


def test_a_drive_monitor_that_fails_stops_too() -> None:
    with pytest.raises(LimitError, match="'drive' reads nan at sample 5000"):
        measure(Failing(5000, lambda seen: seen * np.nan, "drive"), WALK, IDEAL, CAPTURE, Limits())


@settings(max_examples=15)
@given(begin=st.integers(300, 15_000))
def test_a_frozen_position_stops_within_its_time(begin: int) -> None:
    held: list[float] = []

    def freeze(seen: np.ndarray) -> np.ndarray:
        held.append(float(seen[0]))
        return np.full_like(seen, held[0])

    rig = Failing(begin, freeze)
    with pytest.raises(LimitError, match="'ideal' is frozen"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits())
    assert rig.given <= begin + 2000 + 800, "0.1 s, and a block on each side"


def test_a_reading_that_rests_with_the_drive_is_not_frozen() -> None:
    """At rest before a step and long after it, and where it is said that the sensor is slow."""
    measure(VirtualRig(ACTUATOR, BENCH), Step(60.0), IDEAL, Capture(1.0, 1e-3, 0.4), Limits())
    measure(Failing(0, lambda seen: 0.0 * seen), WALK, IDEAL, CAPTURE, Limits(frozen=float("inf")))


def test_a_jump_beyond_an_end_stop_stops() -> None:
    rig = Failing(7000, lambda seen: seen + 60e-6)
    with pytest.raises(LimitError, match="beyond the end stop at 50 µm"):
        measure(rig, Sawtooth(65.0, 5.0), IDEAL, CAPTURE, Limits(max_position=50e-6))
    assert rig.given <= 7400


def test_end_stops_count_from_home_over_runs_of_a_rig() -> None:
    rig = VirtualRig(ACTUATOR, BENCH)
    limits, short = Limits(max_position="30 um"), Capture(0.45, 1e-3, 0.02)
    there, back = Sawtooth(65.0, 20.0, periods=6), ReverseSawtooth(65.0, 20.0, periods=6)
    walked = measure(rig, there, IDEAL, short, limits)["end_effector_position"][-1]
    assert 12e-6 < walked < 25e-6
    with pytest.raises(LimitError, match=r"at 3\d\.\d+ µm from home"):
        measure(rig, there, IDEAL, short, limits)
    assert rig.origin < 31e-6
    for _ in range(2):
        measure(rig, back, IDEAL, short, Limits(min_position="-100 um"))
    home = Home()  # home as it is set now: where two walks back have brought it
    measure(rig, there, IDEAL, short, limits, home=home)
    assert home.position == pytest.approx(float(walked), rel=0.1)


def test_a_recording_that_was_stopped_is_said_to_be(tmp_path: Path) -> None:
    with pytest.raises(LimitError) as caught:
        measure(VirtualRig(ACTUATOR, BENCH), WALK, CHANNELS, CAPTURE, Limits(max_position=10e-6))
    kept = caught.value.recording  # type: ignore[attr-defined]
    assert kept.attrs["outcome"].startswith("stopped: the end-effector is at 1")
    assert kept["end_effector_position"].max() > 9e-6
    assert not list(tmp_path.iterdir())


def test_a_disk_without_room_refuses_before_the_first_volt(tmp_path: Path) -> None:
    rig = VirtualRig(ACTUATOR, BENCH)
    with pytest.raises(OSError, match="no room for"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits(), save=tmp_path / "gone" / "walk.nc")
    assert rig.output()[1].tolist() == [0.0]


def test_samples_are_beside_the_recording_while_it_is_made_and_gone_after(tmp_path: Path) -> None:
    seen: list[int] = []

    def look(_doing: str, _done: float) -> None:
        seen.extend(file.stat().st_size for file in tmp_path.glob(".walk.*.samples"))

    made = measure(
        VirtualRig(ACTUATOR, BENCH), WALK, IDEAL, CAPTURE, Limits(), progress=look, save=tmp_path / "walk.nc"
    )
    assert min(seen) > 2 * 8 * 20_000
    assert [file.name for file in tmp_path.iterdir()] == ["walk.nc"]
    np.testing.assert_array_equal(
        open_recording(tmp_path / "walk.nc")["drive_voltage"], made["drive_voltage"]
    )


class Told(VirtualRig):
    """A rig that learns from its device where it is only when it is armed."""

    def __init__(self) -> None:
        super().__init__(ACTUATOR, BENCH)
        self.true = 0.0

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        super().arm(inputs, samples)
        self.origin = self.true

    def stop(self, slew: float) -> None:
        super().stop(slew)
        self.true, self.origin = self.origin, 0.0


def test_end_stops_count_from_where_the_device_says_that_it_is() -> None:
    rig, home = Told(), Home()
    measure(rig, WALK, IDEAL, CAPTURE, Limits(), home=home)
    walked = rig.true
    with pytest.raises(LimitError, match="beyond the end stop"):
        measure(rig, WALK, IDEAL, CAPTURE, Limits(max_position=1.2 * walked), home=home)
    assert 1.0 * walked < home.position < 1.3 * walked  # type: ignore[operator]


@pytest.mark.parametrize("both", [False, True])
def test_a_stop_that_fails_in_this_program_asks_people_to_switch_off(both: bool) -> None:
    class Stuck(VirtualRig):
        def fetch(self) -> np.ndarray:
            if both:
                raise RigError("it gives nothing")
            return super().fetch()

        def stop(self, slew: float) -> None:
            raise RigError("it does not stop")

    with pytest.raises(RigError) as caught:
        measure(Stuck(ACTUATOR, BENCH), WALK, IDEAL, CAPTURE, Limits())
    assert "switch the amplifier off" in caught.value.__notes__[0]
    assert str(caught.value) == ("it gives nothing" if both else "it does not stop")
