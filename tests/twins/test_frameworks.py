"""Frameworks of laboratories move a twin through our clients: the examples run against the real libraries."""

from __future__ import annotations

import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .serving import ROOT, drive, drivers_python, environment, served, twin_of

EXAMPLES = ROOT / "examples" / "bridges"
STROKE = 80 * 0.1275e-6  # m at 80 V


@pytest.fixture
def twin() -> Any:
    return twin_of("mcs2", axes=1, travel=4e-3)


@pytest.fixture
def where(twin: Any) -> Iterator[str]:
    with served(twin) as port:
        yield f"127.0.0.1:{port}"


def test_a_plan_of_bluesky_scans_by_ophyd_async(where: str, twin: Any) -> None:
    rows = drive(EXAMPLES / "ophyd_stage.py", where)["rows"]
    assert [row["stage-steps"] for row in rows] == [0, 5, 10, 15, 20]
    positions = np.array([row["stage-position"] for row in rows])
    assert np.all((np.diff(positions) > 5e-6) & (np.diff(positions) < 5 * STROKE))
    assert twin.channels[0].read() == pytest.approx(positions[-1], abs=STROKE)


def test_qcodes_sweeps_into_a_database(where: str, tmp_path: Path) -> None:
    said = drive(EXAMPLES / "qcodes_stage.py", where, tmp_path, HOME=str(tmp_path))
    assert said["stage_amplitude"] == [40.0, 60.0, 80.0]
    walked = np.diff(said["stage_position"])
    assert 10e-6 < walked[0] < walked[1] < 10 * STROKE  # more volts, larger steps
    assert "must be between" in said["refused"]
    assert (tmp_path / "walks.db").stat().st_size > 0


def test_a_procedure_of_pymeasure_walks_into_a_file(where: str, tmp_path: Path) -> None:
    said = drive(EXAMPLES / "pymeasure_walk.py", where, tmp_path / "walk.csv")
    steps, positions = np.array(said["rows"]).T
    assert steps.tolist() == [10.0, 20.0, 30.0]
    assert np.all((np.diff(positions) > 10e-6) & (np.diff(positions) < 10 * STROKE))
    assert said["status"] == 0  # finished
    assert "position (m)" in (tmp_path / "walk.csv").read_text(encoding="utf-8")


def test_epics_clients_move_it_through_an_ioc(where: str, twin: Any, tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    network = {
        "EPICS_CA_ADDR_LIST": "127.0.0.1",
        "EPICS_CA_AUTO_ADDR_LIST": "NO",
        "EPICS_CA_SERVER_PORT": port,
        "EPICS_CAS_INTF_ADDR_LIST": "127.0.0.1",
    }
    before = twin.channels[0].axis.stage.position
    command = [drivers_python(), "-W", "ignore", str(EXAMPLES / "epics_ioc.py"), where, "LAB:stage"]
    with (tmp_path / "ioc.log").open("w") as log:
        ioc = subprocess.Popen(command, env=environment(**network), stdout=log, stderr=log)
        try:
            said = drive("caproto_client.py", 0, "LAB:stage", **network)
        finally:
            ioc.terminate()
            ioc.wait(20)
    assert said["done"] == 1
    assert said["moving"] == 0
    assert (said["target"], said["after"]) == (30, 30)
    assert 30e-6 < said["end"] - said["begin"] < 30 * STROKE
    assert twin.channels[0].axis.stage.position - before == pytest.approx(
        said["end"] - said["begin"], abs=STROKE
    )
    assert "9999970 steps are not up to 100000" in said["error"]
