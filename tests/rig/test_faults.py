"""A small fault study: every kind of fault once, at random instants, in real processes."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from benchmarks import fault_judge, faults
from benchmarks.fault_device import WATCHED


def test_faults_at_random_instants_end_at_zero_volts_and_keep_what_was_recorded() -> None:
    seed = random.randrange(10**6)
    found = faults.study(len(faults.FAULTS), seed, workers=2)
    assert len(found) == len(faults.FAULTS)
    assert not [(one.fault, one.wrong) for one in found if one.wrong], f"seed {seed}"
    # Where the instants of twelve faults are by chance, an output is hit by half of them.
    assert any(one.late is not None for one in found), f"no fault hit an output, seed {seed}"
    assert any(one.finished for one in found)
    assert any(one.unfinished for one in found)


RUN = {
    "stopped": 100.5, "began": 100.0, "failed": None, "fetched": 0.5, "volts": 60.0, "ramp": 0.06, "end": 0.0,
    "least": 0.0, "greatest": 60.0, "slew": 1e4, "step": 0.078, "slid": 0.0,
}  # fmt: skip
LIMITS = {"max_voltage": 60.0, "max_slew": 1e6, "stop_slew": 1000.0}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"end": 59.0}, "ended at"),
        ({"greatest": 60.2}, "the output went from"),
        ({"least": -1.0}, "the output went from"),
        ({"slew": 2e7}, "changed at"),
        ({"ramp": 0.2}, "the ramp from"),
        ({"stopped": 101.0}, "began 0.900 s after"),
    ],
)
def test_the_study_notices_what_is_wrong(changes: dict, said: str) -> None:
    assert faults.judge("stop", 100.1, [RUN], LIMITS)[1] == ["the ramp began 0.400 s after the fault"]
    assert faults.judge("stop", 100.3, [RUN], LIMITS)[1] == []
    assert faults.judge("stop", 100.1, [RUN], LIMITS, stalled=0.2)[1] == []
    assert any(said in one for one in faults.judge("stop", 100.1, [RUN | changes], LIMITS)[1])


def seen(folder: Path, volts: list[float], positions: list[float]) -> tuple[float, list[str]]:
    """What the study says of an observer's records."""
    records = zip(np.arange(len(volts)), volts, positions, strict=True)
    (folder / "watched.bin").write_bytes(b"".join(WATCHED.pack(*one) for one in records))
    (folder / "homed").touch()
    limits = {"max_voltage": 60.0, "max_position": 20e-6, "amplitude": 50.0, "frequency": 10.0}
    return fault_judge.watched(folder, "stop", limits, 0.0)


def test_the_study_notices_what_an_observer_sees(tmp_path: Path) -> None:
    step = fault_judge.GAIN * 50.0
    assert seen(tmp_path, [0.0, 59.0, 0.0], [0.0, 19e-6, 19e-6]) == (0.0, [])
    beyond, wrong = seen(tmp_path, [0.0, 59.0, 0.0], [0.0, 20e-6 + 0.9 * step, 0.0])
    assert beyond == pytest.approx(0.9)
    assert not wrong
    assert "steps beyond its end stop" in seen(tmp_path, [0.0, 59.0], [0.0, 20e-6 + 9 * step])[1][0]
    assert "the output was seen at" in seen(tmp_path, [0.0, 61.0], [0.0, 0.0])[1][0]
    assert "the output was seen at" in seen(tmp_path, [-1.0, 50.0], [0.0, 0.0])[1][0]
