"""Fixtures that several tests of this folder share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from stickslip.rig import armed

from .serving import drive


@pytest.fixture(autouse=True)
def _armed() -> Iterator[None]:
    """Behind a twin no piezo is waiting: its rigs are armed for every test."""
    with armed("a twin"):
        yield


@pytest.fixture(scope="session")
def card(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """What was done with a simulated DAQ card, and the folder of the walks."""
    folder = tmp_path_factory.mktemp("card")
    return drive("daqmx_simulated.py", folder), folder
