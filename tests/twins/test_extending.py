"""A back end is one file, and a device one folder: those of the documentation, as they stand there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

import stickslip as ss
from stickslip.quantities import registry
from stickslip.rig.attached import known_devices

from .serving import ROOT
from .wired import CAPTURE, DRIVE, LIMITS


def written(name: str) -> str:
    """A program of the documentation."""
    text = (ROOT / "docs" / "add-device.md").read_text(encoding="utf-8")
    (code,) = re.findall(rf"```python\n# {re.escape(name)}\n(.*?)```", text, re.DOTALL)
    return code


# Lists the device, serves its twin as the command line does, finds it at its address and makes it step.
DEVICE = """
import sys, threading
from typer.testing import CliRunner
from stickslip.rig import devices

devices.__path__.append(sys.argv[1])
from stickslip.cli import app
from stickslip.physics.actuator import load_actuator
from stickslip.rig.attached import probe
from stickslip.rig.twins import TwinServer, make_twin

print(CliRunner().invoke(app, ["rigs"]).output)
twin = make_twin("Acme1", load_actuator("kang2007"), seed=1)
with TwinServer(twin) as server:
    threading.Thread(target=server.serve_forever, daemon=True).start()
    port = server.server_address[1]
    (found,) = probe("127.0.0.1", port)
    print(found.says, found.name)
    before = twin.axis.state()[2]
    client = devices.acme.Acme1("127.0.0.1", port=port)
    client.step(0, 3, 100.0, 100.0)
    while twin.axis.moving:
        pass
    client.close()
    print("moved", twin.axis.state()[2] - before > 1e-6)
    server.shutdown()
"""


def test_the_device_of_the_documentation(tmp_path: Path) -> None:
    folder = tmp_path / "acme"
    folder.mkdir()
    for name in ("__init__.py", "twin.py"):
        (folder / name).write_text(written(f"acme/{name}"), encoding="utf-8")
    said = subprocess.run(
        [sys.executable, "-c", DEVICE, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert said.returncode == 0, said.stderr
    assert "Acme1 (positioner): ACME 1 (TCP); steps" in said.stdout
    assert said.stdout.endswith("ACME 1 Acme1\nmoved True\n")


def test_the_back_end_of_the_documentation(tmp_path: Path) -> None:
    (tmp_path / "my_loop.py").write_text(written("my_loop.py"), encoding="utf-8")
    rig = registry.rigs.find("my_loop.py:Loopback", tmp_path)()
    channels = {"drive_voltage": ss.rig.Channel("drive")}
    recording = ss.rig.measure(rig, DRIVE, channels, CAPTURE, LIMITS)
    assert recording.sizes["time"] == 1600
    assert float(recording.drive_voltage.max()) == 64.87  # 499 of 500 updates of 65 V
    assert np.ptp(recording.drive_voltage.values[1501:]) == 0.0  # three periods of 50 ms
    assert rig.volts.tolist() == [0.0]
    assert "the documentation" in {one.about.verified for one in known_devices()}
