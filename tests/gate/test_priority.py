"""Priority of processes: what owns an output comes first, what computes comes last."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from stickslip.gate.priority import LAST

RAISED = -3
UNPERMITTED = "resource.setrlimit(resource.RLIMIT_NICE, (0, 0)); os.geteuid() or os.setuid(65534)"


def after(code: str) -> tuple[int, bool]:
    """Nice value of a new process after some code, and whether it leads a session."""
    code = (
        "import os, resource\nfrom contextlib import suppress\nfrom stickslip.gate import priority\n"
        f"{code}\nprint(os.getpriority(os.PRIO_PROCESS, 0), os.getsid(0) == os.getpid())"
    )
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    nice, leads = said.split()
    return int(nice), leads == "True"


def own() -> int:
    """Nice value of the tests."""
    return os.getpriority(os.PRIO_PROCESS, 0)


def test_what_owns_an_output_comes_first_where_that_is_permitted() -> None:
    asked = after(f"with suppress(OSError): os.setpriority(os.PRIO_PROCESS, 0, {RAISED})")
    assert after(f"priority.come_first({RAISED})") == asked


def test_without_the_permission_the_priority_stays() -> None:
    assert after(f"{UNPERMITTED}; priority.come_first({RAISED})") == (own(), False)


@pytest.mark.parametrize("nice", [0, 15])
def test_what_computes_comes_last_in_a_session_of_its_own(nice: int) -> None:
    begun = max(nice, own())
    asked = f"os.setpriority(os.PRIO_PROCESS, 0, {begun}); priority.come_last(); priority.come_last()"
    assert after(asked) == (max(begun, LAST), True)
