"""Coverage of the first two seconds of each test (a plugin of pytest: ``-p tools.brief_coverage``).

Long tests run the same lines again and again; traced, fits took 1.5 times as long. What only the rest of a
long test runs counts as not run: the coverage that is reported is a lower bound.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Generator
from types import FrameType
from typing import Any

import pytest

_TRACED = 2.0  # s of CPU time


def _end(number: int, frame: FrameType | None) -> None:
    sys.settrace(None)


signal.signal(signal.SIGVTALRM, _end)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol() -> Generator[None, object, object]:
    trace: Any = sys.gettrace()
    if trace is None:  # no coverage is asked for, or a debugger is not to be lost
        return (yield)
    signal.setitimer(signal.ITIMER_VIRTUAL, _TRACED)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        sys.settrace(trace)
