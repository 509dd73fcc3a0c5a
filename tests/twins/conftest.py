"""Fixtures that several tests of this folder share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from .serving import drive


@pytest.fixture(scope="session")
def card(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    """What was done with a simulated DAQ card, and the folder of the walks."""
    folder = tmp_path_factory.mktemp("card")
    return drive("daqmx_simulated.py", folder), folder
