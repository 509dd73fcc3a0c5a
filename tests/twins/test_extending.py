"""A back end is one file: that of the documentation records as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

import stickslip as ss
from stickslip.quantities import registry
from stickslip.rig.attached import known_devices

from .serving import ROOT
from .wired import CAPTURE, DRIVE, LIMITS


def test_the_back_end_of_the_documentation(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n# my_loop\.py\n(.*?)```", text, re.DOTALL)
    (tmp_path / "my_loop.py").write_text(code, encoding="utf-8")
    rig = registry.rigs.find("my_loop.py:Loopback", tmp_path)()
    channels = {"drive_voltage": ss.rig.Channel("drive")}
    recording = ss.rig.measure(rig, DRIVE, channels, CAPTURE, LIMITS)
    assert recording.sizes["time"] == 1600
    assert float(recording.drive_voltage.max()) == 64.87  # 499 of 500 updates of 65 V
    assert np.ptp(recording.drive_voltage.values[1501:]) == 0.0  # three periods of 50 ms
    assert rig.volts.tolist() == [0.0]
    assert "the documentation" in {one.about.verified for one in known_devices()}
