"""Common ground of all tests.

The user's own cache of compiled kernels is used on purpose: a fresh clone compiles once, the next run starts
at once. It is keyed by the package's source, so it cannot hide an edit; tests of the cache bring a folder.
"""

from __future__ import annotations

import os
import time
from collections.abc import Generator
import signal

import pytest
from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"  # here and in commands that tests start: no display

# A shell starts what runs in the background with Ctrl-C ignored, and that is inherited: commands that tests
# interrupt would not notice.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run of continuous integration, new ones at a desk; the first example compiles.
settings.register_profile("stickslip", deadline=None, max_examples=40, derandomize="CI" in os.environ)
settings.load_profile("stickslip")

# Seconds of processor time; twice what the longest such test takes while its lines are counted.
MOST_AS_PLAIN_PYTHON = 30.0


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    """A test that has become too long for the pass with the JIT off is told so, or that pass grows unseen."""
    begun = time.process_time()
    result = yield
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        took = time.process_time() - begun
        assert took < MOST_AS_PLAIN_PYTHON, (
            f"{took:.0f} s as plain Python: mark it compiled, and walk its lines in a shorter test"
        )
    return result
