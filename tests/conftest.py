"""Common ground of all tests.

The user's own cache of compiled kernels is used on purpose: a fresh clone compiles once, the next run starts
at once. It is keyed by the package's source, so it cannot hide an edit; tests of the cache bring a folder.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings
from numba.core import event

os.environ["MPLBACKEND"] = "Agg"  # here and in commands that tests start: no display
# What is known of real rigs, from where positions count, is not the user's.
os.environ["STICKSLIP_RIGS"] = tempfile.mkdtemp(prefix="stickslip-rigs-")

# A shell starts what runs in the background with Ctrl-C ignored, and that is inherited: commands that tests
# interrupt would not notice.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every run of continuous integration, new ones at a desk; the first example compiles.
settings.register_profile("stickslip", deadline=None, max_examples=40, derandomize="CI" in os.environ)
settings.load_profile("stickslip")


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file can have more than 500 bytes: a limit of the system, which names no file either."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


class _Untraced(event.Listener):
    """Coverage waits while Numba compiles, which takes half as long again when it is traced: most of what
    runs then is Numba's. What is ours, the code that writes a plant's equations, is traced in its tests."""

    def __init__(self) -> None:
        self._of_thread = threading.local()

    def on_start(self, event: Any) -> None:
        depth = self._of_thread.depth = getattr(self._of_thread, "depth", 0) + 1
        if depth == 1:
            self._of_thread.trace = sys.gettrace()
            if "tests/plant/" not in os.environ.get("PYTEST_CURRENT_TEST", ""):
                sys.settrace(None)

    def on_end(self, event: Any) -> None:
        self._of_thread.depth -= 1
        if self._of_thread.depth == 0:
            sys.settrace(self._of_thread.trace)


event.register("numba:compile", _Untraced())


@pytest.fixture(autouse=True)
def _figures_are_closed() -> Iterator[None]:
    """Those that `plot` opened: Matplotlib keeps them all, and warns of the twenty-first."""
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        pyplot.close("all")
