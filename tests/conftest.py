"""Common ground of all tests."""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
from collections.abc import Iterator

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

os.environ["MPLBACKEND"] = "Agg"  # here and in commands that tests start: no display
# Tests and the commands that they start share few cores: several threads of linear algebra only wait for
# each other. The variable is for commands and libraries loaded later, the call for those loaded already.
os.environ["OPENBLAS_NUM_THREADS"] = "1"
threadpool_limits(1, user_api="blas")
# What is known of real rigs, from where positions count, is not the user's.
os.environ["STICKSLIP_RIGS"] = tempfile.mkdtemp(prefix="stickslip-rigs-")

# A shell starts what runs in the background with Ctrl-C ignored, and that is inherited: commands that tests
# interrupt would not notice.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run of continuous integration, new ones at a desk.
settings.register_profile("stickslip", deadline=None, max_examples=40, derandomize="CI" in os.environ)
settings.load_profile("stickslip")


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file can have more than 500 bytes: a limit of the system, which names no file either."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def no_term_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit that does not explain its walks says so, and fits no further terms: these take 20 s of CPU."""
    monkeypatch.setattr("stickslip.identify.walk.diagnosis.SECONDS", 0.0)


@pytest.fixture(autouse=True)
def _figures_are_closed() -> Iterator[None]:
    """Those that `plot` opened: Matplotlib keeps them all, and warns of the twenty-first."""
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        pyplot.close("all")
