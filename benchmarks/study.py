"""Studies measured: throughput beside the bare ensemble, overhead of a task, memory of a worker, kills, and
how many tasks a second a scheduler bears.

``python -m benchmarks.study throughput|overhead|memory|kills|scheduler [NUMBERS]`` prints figures, NUMBERS in
the order of the function's arguments; ``... picture STORE FILE`` draws a map; docs/studies.md has them.
"""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client

import stickslip as ss
from stickslip.study import Grid, Random, Study, WalksFromRest, compare_studies
from stickslip.study.running import prepared
from stickslip.study.store import Store

RANGES = {"sigma_0": ("1 N/um", "2 N/um"), "coulomb_force": ("0.3 N", "0.8 N"), "amplitude": ("40 V", "90 V")}
SHORT = ss.Sawtooth(65.0, 50.0, periods=2)
LONG = ss.Sawtooth(65.0, 5.0, periods=8)
KANG = ss.load_actuator("kang2007")


def logged(found: Any) -> dict[str, Any]:
    """A summary that counts: a line for each time that a task was computed, with its first member."""
    time.sleep(float(os.environ.get("STUDY_PAUSE", "0")))
    with open(os.environ["STUDY_LOG"], "a", encoding="utf-8") as log:
        log.write(f"{found.sizes['member']} {found['sigma_0'].values[0]!r}\n")
    return {"again": found["net_displacement"]}


def cpu(who: int = resource.RUSAGE_SELF) -> float:
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def throughput(members: int = 1 << 18, task: int = 1 << 14) -> None:
    """A study on two processes and the bare ensemble in one, of the same members; CPU times, for other
    programs run too."""
    study = Study(Random(RANGES, members), WalksFromRest(KANG, LONG), task=task)
    columns = study.columns({"member": slice(0, members)})
    begun, wall = cpu(), time.perf_counter()
    bare = ss.simulate_ensemble(KANG, LONG, parameters=columns, threads=2)
    bare_cpu, bare_wall = cpu() - begun, time.perf_counter() - wall
    with tempfile.TemporaryDirectory() as folder:
        told: list[float] = []
        before = cpu(resource.RUSAGE_CHILDREN), cpu()
        found = ss.run_study(
            study,
            Path(folder, "s.zarr"),
            workers=2,
            progress=lambda doing, done: told.append(time.perf_counter()),
        )
        children, own = cpu(resource.RUSAGE_CHILDREN) - before[0], cpu() - before[1]
        empty = Study(Random(RANGES, 4), WalksFromRest(KANG, LONG), task=2)
        start = cpu(resource.RUSAGE_CHILDREN)
        ss.run_study(empty, Path(folder, "empty.zarr"), workers=2)
        start = cpu(resource.RUSAGE_CHILDREN) - start
        same = bool(np.array_equal(found["net_displacement"].values, bare["net_displacement"].values))
        tasks, size = (
            members // task,
            sum(f.stat().st_size for f in Path(folder, "s.zarr").rglob("*") if f.is_file()),
        )
    working = children - start
    print(f"members {members:,} in {tasks} tasks; equal: {same}; {size / 1e6:.1f} MB on the disk")
    print(f"bare ensemble: {bare_cpu:.2f} s of CPU, {bare_wall:.2f} s")
    print(f"study: workers {working:.2f} s of CPU and {start:.2f} s to start, client {own:.2f} s")
    share = f"{bare_cpu / working:.1%}, with the client {bare_cpu / (working + own):.1%}"
    print(f"throughput of the bare one, by CPU: {share}")
    print(f"a task: {working / tasks:.3f} s, over the bare one {(working - bare_cpu) / tasks * 1e3:.1f} ms")


def overhead(tasks: int = 200) -> None:
    """What a task costs beyond its members, in one process: the same task with and without all around it."""
    from stickslip.study.task import run_task

    task = 1 << 14
    study = Study(Random(RANGES, tasks * task), WalksFromRest(KANG, LONG), task=task)
    place = {"member": slice(0, task)}
    with tempfile.TemporaryDirectory() as folder:
        store = prepared(study, Path(folder, "s.zarr"))
        found, times = study.computed(study.columns(place)), []
        for number in range(tasks):
            begun, wall = cpu(), time.perf_counter()
            columns = study.columns(store.layout.place(number))
            store.write(number, found, columns)
            times.append((cpu() - begun, time.perf_counter() - wall))
        begun = cpu()
        run_task(study, store, 0)
        whole = cpu() - begun
    of_cpu, of_wall = np.median(times, axis=0)
    print(f"columns and chunks of a task: {of_cpu * 1e3:.1f} ms of CPU, {of_wall * 1e3:.1f} ms")
    print(f"the whole task: {whole:.2f} s of CPU; overhead {of_cpu / whole:.2%}")


def memory(members: int = 1 << 18, task: int = 1 << 14) -> None:
    """Most memory of the workers of a study, by its size."""
    for size in (members // 4, members):
        with tempfile.TemporaryDirectory() as name:
            environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1]), "STUDY_LOG": name}
            code = _LOCAL.format(members=size, task=task, store=Path(name) / "s.zarr")
            client = subprocess.Popen([sys.executable, "-c", code], env=environment)
            most = 0
            while client.poll() is None:
                most = max(most, looked_at(name))
                time.sleep(0.02)
            print(f"{size:,} members: {most} MB", flush=True)


def looked_at(name: str) -> int:
    """Return the most memory [MB] of the workers that know the name."""
    most = 0
    for one in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (one / "cmdline").read_bytes().split(b"\0")
            known = f"STUDY_LOG={name}".encode() in (one / "environ").read_bytes().split(b"\0")
            if known and b"stickslip.study.worker" in words:
                status = (one / "status").read_text()
                most = max(most, int(status.split("VmHWM:")[1].split()[0]) // 1024)
    return most


_LOCAL = """
import stickslip as ss
from benchmarks.study import KANG, RANGES, SHORT
from stickslip.study import Random, Study, WalksFromRest
ss.run_study(Study(Random(RANGES, {members}), WalksFromRest(KANG, SHORT), task={task}), "{store}", workers=2)
"""


class Cluster:
    """A dask scheduler and workers of one thread on this machine."""

    def __init__(self, folder: Path, workers: int) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address, self._folder = f"tcp://127.0.0.1:{self.port}", folder
        self.scheduler = self.start_scheduler()
        self.workers = [self.start_worker() for _ in range(workers)]

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        return self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")

    def start_worker(self) -> subprocess.Popen[bytes]:
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(self._folder)]
        return self._start("worker", self.address, *options)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        with (self._folder / "log").open("ab") as log:
            return subprocess.Popen([sys.executable, "-m", "dask", *words], stderr=log)

    def alive(self) -> None:
        """Start again what has ended."""
        if self.scheduler.poll() is not None:
            self.scheduler = self.start_scheduler()
        self.workers = [w if w.poll() is None else self.start_worker() for w in self.workers]

    def kill(self, what: str, client: subprocess.Popen[bytes], chosen: random.Random) -> None:
        """A worker, the client, or the scheduler: with that its workers go."""
        victims = {"worker": [chosen.choice(self.workers)], "client": [client]}
        for one in victims.get(what, [self.scheduler, *self.workers]):
            one.kill()
            one.wait()

    def end(self) -> None:
        for process in (self.scheduler, *self.workers):
            process.kill()
            process.wait()


def kills(members: int = 1 << 20, task: int = 2048, count: int = 50, pause: float = 0.0) -> None:
    """A study on a dask cluster, of which workers, scheduler and client are killed at random; beside it the
    same on this machine, without. A task waits for `pause` s: so there is time for many kills in few."""
    chosen = random.Random(19)
    os.environ["STUDY_PAUSE"] = str(pause)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, store = folder / "computed", folder / "killed.zarr"
        os.environ |= {"STUDY_LOG": str(log), "PYTHONPATH": str(Path(__file__).parents[1])}
        (folder / "client.py").write_text(_CLIENT.format(members=members, task=task, file=__file__))
        cluster = Cluster(folder, 2)
        killed = {"worker": 0, "scheduler": 0, "client": 0}
        tasks, begun = members // task, time.perf_counter()
        client = None
        try:
            while True:  # until a client says that all is done
                if client is None:
                    client = subprocess.Popen([sys.executable, folder / "client.py", store, cluster.address])
                done = int(Store(store).done().sum()) if (store / "zarr.json").exists() else 0
                many = sum(killed.values())
                if client.poll() is not None:
                    print(f"client ended: {client.returncode}, {done} of {tasks} tasks", flush=True)
                    if client.returncode or done == tasks:
                        break
                    client = None
                # Each when its share of the tasks is done, somewhere within the next ones.
                elif many < count and done > tasks * (many + 0.5) / (count + 1):
                    time.sleep(chosen.random() * max(pause, 0.1))
                    what = chosen.choice(["worker"] * 4 + ["client", "scheduler"])
                    killed[what] += 1
                    cluster.kill(what, client, chosen)
                    client = None if what == "client" else client
                    print(f"{done} of {tasks}: killed {what}", flush=True)
                cluster.alive()
                time.sleep(0.05)
        finally:
            cluster.end()
        took = time.perf_counter() - begun
        lines = [line.split() for line in log.read_text().splitlines()]
        times = Counter(first for size, first in lines if int(size) == task)
        os.environ |= {"STUDY_LOG": str(folder / "other"), "STUDY_PAUSE": "0"}
        study = Study(Random(RANGES, members), WalksFromRest(KANG, SHORT), f"{__file__}:logged", task=task)
        ss.run_study(study, folder / "whole.zarr", workers=2)
        same = compare_studies(store, folder / "whole.zarr")
        bytewise = all(
            (store / f.relative_to(folder / "whole.zarr")).read_bytes() == f.read_bytes()
            for f in (folder / "whole.zarr").rglob("*")
            if f.is_file()
        )
        # In hand: one of a worker, of two with the scheduler, and what a client had given to two workers.
        most = killed["worker"] + 2 * killed["scheduler"] + 6 * killed["client"]
        print(f"{members:,} members in {tasks} tasks, {took:.0f} s; killed {json.dumps(killed)}")
        print(f"equal to the last bit: {same.equal and not same.said}; every file: {bytewise}")
        print(f"computed: {len(times)} tasks, again {times.total() - tasks}; at most {most} were in hand")


_CLIENT = """
import sys
import stickslip as ss
from benchmarks.study import KANG, RANGES, SHORT
from stickslip.study import Random, Study, WalksFromRest
study = Study(Random(RANGES, {members}), WalksFromRest(KANG, SHORT), "{file}:logged", task={task})
ss.run_study(study, sys.argv[1], scheduler=sys.argv[2])
"""


def asleep(columns: Any) -> dict[str, Any]:
    """A task that only takes its time."""
    if columns["x"].size > 2:
        time.sleep(float(os.environ["STUDY_SLEEP"]))
    return {"value": columns["x"]}


def scheduler(workers: int = 200, seconds: float = 1.0, tasks: int = 2000) -> None:
    """Workers, each a process, that only sleep for as long as a task takes: what the scheduler and the client
    bear, and what goes through the scheduler's door, counted by what stands in front of it."""
    from stickslip.study import Own

    os.environ["STUDY_SLEEP"] = str(seconds)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cluster = Cluster(folder, 0)
        door = Door(cluster.port)
        address = f"tcp://127.0.0.1:{door.port}"
        (folder / "sleepers.py").write_text(_SLEEPERS)
        words = [str(folder / "sleepers.py"), address, str(workers)]
        quiet = {**os.environ, "DASK_DISTRIBUTED__LOGGING__DISTRIBUTED": "error"}
        sleepers = subprocess.Popen([sys.executable, *words], cwd=folder, env=quiet, start_new_session=True)
        try:
            with Client(address, timeout=120, set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=600)
            print(f"{workers} sleepers are there", flush=True)
            idle = door.bytes, time.perf_counter(), seconds_of(cluster.scheduler.pid)
            time.sleep(10.0)
            idle_bytes, passed = door.bytes - idle[0], time.perf_counter() - idle[1]
            idle_cpu = (seconds_of(cluster.scheduler.pid) - idle[2]) / passed
            study = Study(Grid({"x": np.arange(4.0 * tasks)}), Own(f"{__file__}:asleep"), task=4)
            seen: list[tuple[float, ...]] = []
            ended = threading.Event()

            def watch() -> None:
                while not ended.wait(0.1):
                    seen.append((time.time(), door.bytes, seconds_of(cluster.scheduler.pid), cpu()))

            threading.Thread(target=watch, daemon=True).start()
            ss.run_study(study, folder / "s.zarr", scheduler=address)
            ended.set()
            written = np.sort(Store(folder / "s.zarr").written())
            # From the first task to the last: all workers are ready, and have something to do.
            between, times = written[[0, -1]], [one[0] for one in seen]
            sent, busy, own = (
                float(np.ptp(np.interp(between, times, column)))
                for column in list(zip(*seen, strict=True))[1:]
            )
            took = float(np.ptp(between))
            print(
                f"{tasks} tasks of {seconds} s: {took:.1f} s, at best {(tasks / workers - 1) * seconds:.1f} s"
            )
            print(
                f"{tasks / took:.0f} tasks/s; {workers / seconds:.0f} would be all that these workers can do"
            )
            busy -= idle_cpu * took
            print(f"a task: scheduler {busy / tasks * 1e3:.2f} ms of CPU, client {own / tasks * 1e3:.2f} ms")
            beats = idle_bytes / passed * took
            print(f"a task: {(sent - beats) / tasks:.0f} bytes to and from the scheduler, and")
            print(f"  {beats / tasks:.0f} bytes of what workers say every second or so, whatever they do")
            print(
                f"idle: {idle_cpu:.1%} of a processor, {idle_bytes / passed / workers:.0f} bytes/s a worker"
            )
        finally:
            os.killpg(sleepers.pid, signal.SIGKILL)
            sleepers.wait()
            cluster.end()
            door.close()


def seconds_of(process: int) -> float:
    """Of CPU, that a process has taken [s]."""
    used = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK")


class Door:
    """A way to a port of this machine that counts the bytes which go through it, both ways."""

    def __init__(self, port: int) -> None:
        self._behind, self.bytes = port, 0
        self._listening = socket.create_server(("127.0.0.1", 0), backlog=512)
        self.port = self._listening.getsockname()[1]
        threading.Thread(target=self._open, daemon=True).start()

    def _open(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                far = self._reached()
                for ends in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=ends, daemon=True).start()

    def _reached(self) -> socket.socket:
        while True:
            try:
                return socket.create_connection(("127.0.0.1", self._behind))
            except ConnectionRefusedError:  # it starts
                time.sleep(0.1)

    def _pass(self, source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                self.bytes += len(data)
                target.sendall(data)
        with suppress(OSError):
            target.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        self._listening.close()


_SLEEPERS = """
import asyncio, os, sys
import stickslip.study.cluster
from distributed import Worker

async def main():
    async with Worker(sys.argv[1], nthreads=1, dashboard=False) as worker:
        await worker.finished()

for _ in range(int(sys.argv[2])):
    if os.fork() == 0:
        asyncio.run(main())
        os._exit(0)
os.wait()
"""


def picture(store: str, file: str) -> None:
    """What a map over seven parameters says, two at a time: quantiles over all others."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter
    from scipy.stats import binned_statistic_2d

    found = ss.study.open_study(store).load()
    there = found["status"].values == 0
    speed = np.abs(found["net_step"].values * found["frequency"].values)[there] * 1e3
    pairs = [("frequency", "amplitude"), ("coulomb_force", "end_effector_mass"), ("sigma_0", "rise_fraction")]
    figure = Figure(figsize=(11, 6.2), layout="constrained")
    axes = figure.subplots(2, 3)
    for column, (across, up) in enumerate(pairs):
        x, y = found[across].values[there], found[up].values[there]
        log = [np.ptp(np.log10(v)) > 0.7 for v in (x, y)]
        spaced = [np.geomspace if one else np.linspace for one in log]
        bins: Any = [of(v.min(), v.max(), 33) for of, v in zip(spaced, (x, y), strict=True)]
        for row, (words, how) in enumerate((("median", 0.5), ("90 % below", 0.9))):
            of: Any = partial(np.quantile, q=how)
            binned = binned_statistic_2d(x, y, speed, of, bins=bins)[0]
            axis = axes[row, column]
            drawn = axis.pcolormesh(*bins, binned.T, norm=LogNorm(), cmap="viridis", rasterized=True)
            figure.colorbar(drawn, ax=axis, label=f"speed, {words} (mm/s)")
            axis.set_xscale("log" if log[0] else "linear")
            axis.set_yscale("log" if log[1] else "linear")
            for one, spread in zip((axis.xaxis, axis.yaxis), log, strict=True):
                one.set_minor_formatter(NullFormatter())
                if spread:
                    one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                    one.set_major_formatter(EngFormatter(sep=""))
            for name, label in ((across, axis.set_xlabel), (up, axis.set_ylabel)):
                unit = str(found[name].attrs["units"])
                label(name.replace("_", " ") + (f" ({unit})" if unit else ""))
    figure.suptitle(f"{there.sum():,} of {found.sizes['member']:,} members with a steady step")
    figure.savefig(file, dpi=80)


if __name__ == "__main__":
    asked: dict[str, Any] = {one.__name__: one for one in (throughput, overhead, memory, kills, scheduler)}
    if sys.argv[1] == "picture":
        picture(*sys.argv[2:])
    else:
        asked[sys.argv[1]](*map(json.loads, sys.argv[2:]))
