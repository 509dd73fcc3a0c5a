"""Studies on a real dask cluster of this machine, whose parts are killed and stopped."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from distributed import Client

import stickslip as ss
import study_functions
from stickslip.study import Draws, Grid, Own, Study, StudyError, WalksFromRest
from stickslip.study.store import Store

FILE = study_functions.__file__
GRID = Grid({"x": np.arange(20.0), "y": np.arange(12.0)})
EXPECTED = np.arange(20.0)[:, None] ** 2 + 10.0 * np.arange(12.0)
STUDY = """
kind: study
measure: {kind: own, function: FILE:slow_squares}
task: 3
grid: {x: {start: 0, stop: 19, points: 20}, y: {start: 0, stop: 11, points: 12}}
"""


class Cluster:
    """A scheduler and workers, each a process of one thread."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._folder = folder
        self.scheduler = self.start_scheduler()
        self.workers = [self.start_worker(), self.start_worker()]

    def start_scheduler(self) -> subprocess.Popen:
        return self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")

    def start_worker(self, address: str = "") -> subprocess.Popen:
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self._folder)]
        return self._start("worker", address or self.address, *options)

    def _start(self, *words: str) -> subprocess.Popen:
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen([sys.executable, "-m", "dask", *words], stderr=log)

    def end(self) -> None:
        for process in (self.scheduler, *self.workers):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    folder = tmp_path_factory.mktemp("cluster")
    os.environ["STUDY_LOG"] = str(folder / "computed")
    made = Cluster(folder)
    yield made
    made.end()
    del os.environ["STUDY_LOG"]


def begin(folder: Path, cluster: Cluster) -> subprocess.Popen:
    study_functions.with_functions(folder / "study.yaml", STUDY)
    words = ["study", str(folder / "study.yaml"), "--store", str(folder / "s.zarr")]
    command = [sys.executable, "-m", "stickslip", *words, "--scheduler", cluster.address]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def wait_for(store: Path, tasks: int, process: subprocess.Popen) -> None:
    while not (store / "zarr.json").exists() or Store(store).done().sum() < tasks:
        assert process.poll() is None
        time.sleep(0.005)


def test_whatever_is_killed_it_goes_on_and_ends_the_same(tmp_path: Path, cluster: Cluster) -> None:
    """A worker, the scheduler with all workers, the client; then a worker hangs until the end."""
    store = tmp_path / "s.zarr"
    run = begin(tmp_path, cluster)
    wait_for(store, 8, run)
    cluster.workers[0].kill()
    cluster.workers[0].wait()
    wait_for(store, 20, run)
    cluster.end()
    cluster.scheduler = cluster.start_scheduler()
    cluster.workers = [cluster.start_worker(), cluster.start_worker()]
    wait_for(store, 40, run)
    run.kill()
    run.wait()
    run = begin(tmp_path, cluster)
    wait_for(store, 60, run)
    cluster.workers[0].send_signal(signal.SIGSTOP)
    assert run.wait() == 0
    cluster.workers[0].send_signal(signal.SIGCONT)
    found = xr.open_zarr(store, chunks=None).load()
    np.testing.assert_array_equal(found["value"], EXPECTED)
    lines = Path(os.environ["STUDY_LOG"]).read_text().splitlines()
    again = sum(not line.endswith(" 2") for line in lines) - 80
    # One in hand of each worker that was killed or hung, and of two when the client went, three for each.
    assert 0 <= again <= 1 + 2 + 2 * 3 + 3


class Cable:
    """What is between a worker and the scheduler, a port of this machine. Cut, it passes nothing on, and
    tells neither end. It counts what went through."""

    def __init__(self, port: int) -> None:
        self._behind, self.bytes, self._whole = port, 0, True
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._listening.getsockname()[1]}"
        self._ends: list[socket.socket] = []
        threading.Thread(target=self._open, daemon=True).start()

    def _open(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                far = socket.create_connection(("127.0.0.1", self._behind))
                self._ends += [near, far]
                for ends in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=ends, daemon=True).start()

    def _pass(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                self.bytes += len(data)
                if self._whole:
                    target.sendall(data)
        if self._whole:
            with suppress(OSError):
                target.shutdown(socket.SHUT_WR)

    def cut(self) -> None:
        self._whole = False

    def close(self) -> None:
        for one in (self._listening, *self._ends):
            one.close()


def test_a_worker_that_is_cut_off_does_not_hold_the_end(tmp_path: Path, cluster: Cluster) -> None:
    cable, store = Cable(cluster.port), tmp_path / "s.zarr"
    worker = cluster.start_worker(cable.address)
    with Client(cluster.address, set_as_default=False) as client:
        client.wait_for_workers(3)
    run = begin(tmp_path, cluster)
    wait_for(store, 20, run)
    cable.cut()
    assert run.wait() == 0
    np.testing.assert_array_equal(xr.open_zarr(store, chunks=None)["value"], EXPECTED)
    worker.kill()
    worker.wait()
    cable.close()


def test_a_task_is_little_to_say(tmp_path: Path, cluster: Cluster) -> None:
    """Between the client and the scheduler; what a worker and the scheduler say is about as much."""
    cable = Cable(cluster.port)
    study = Study(GRID, Own(f"{FILE}:squares"), task=1)
    ss.run_study(study, tmp_path / "s.zarr", scheduler=cable.address)
    assert cable.bytes / 240 < 1000
    cable.close()


def test_results_are_those_of_the_ensemble(tmp_path: Path, cluster: Cluster) -> None:
    model, drive = ss.load_actuator("kang2007"), ss.Sawtooth(65.0, 50.0, periods=2)
    values, amplitudes = np.linspace(1e6, 2e6, 500), [40.0, 65.0]
    points = [Draws({"sigma_0": values}), Grid({"amplitude": amplitudes})]
    study = Study(points, WalksFromRest(model, drive), task=100)
    found = ss.run_study(study, tmp_path / "s.zarr", scheduler=cluster.address)
    columns = {"sigma_0": np.repeat(values, 2), "amplitude": np.tile(amplitudes, 500)}
    bare = ss.simulate_ensemble(model, drive, parameters=columns)
    np.testing.assert_array_equal(found["net_displacement"].values.ravel(), bare["net_displacement"])
    assert not list((tmp_path / "s.zarr").glob(".load-*"))


def test_a_scheduler_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"no dask scheduler answers at tcp://127.0.0.1:9"):
        ss.run_study(Study(GRID, Own(f"{FILE}:squares")), tmp_path / "t.zarr", scheduler="tcp://127.0.0.1:9")
