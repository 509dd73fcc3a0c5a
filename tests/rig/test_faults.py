"""A small fault study: every kind of fault once, at random instants, in real processes."""

from __future__ import annotations

import random

import pytest
from benchmarks import faults


def test_faults_at_random_instants_end_at_zero_volts_and_keep_what_was_recorded() -> None:
    found = faults.study(len(faults.FAULTS), seed=random.randrange(10**6), workers=2)
    assert len(found) == len(faults.FAULTS)
    assert not [(one.fault, one.wrong) for one in found if one.wrong]
    assert sum(one.late is not None for one in found) >= 3, "faults that hit an output"
    assert sum(one.finished for one in found) >= 3
    assert sum(one.unfinished for one in found) >= 2


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
    assert any(said in one for one in faults.judge("stop", 100.1, [RUN | changes], LIMITS)[1])
