"""The device of the fault study: the virtual rig in real time, behind a socket in a process of its own, which
fails when it is told to and writes down what came out of its amplifier.

python -m benchmarks.fault_device FOLDER
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.physics.actuator import load_actuator
from stickslip.rig import Gate, Limits, RigError, VirtualRig, load_bench
from stickslip.rig.limits import LONGEST_STOP
from stickslip.rig.wire import receive, send

# What the device allows by itself; a program's limits are narrower.
OWN = Limits(min_voltage=0.0, max_voltage=150.0, watchdog=0.5, stop_slew=1000.0)


class FailingRig(VirtualRig):
    """Fails as the file `fault.json` says, in one run after it was written; each run is a line of
    `runs.jsonl`."""

    def __init__(self, folder: Path) -> None:
        super().__init__(
            load_actuator("kang2007").replace(stage_reaction=False),
            load_bench("kang2007-bench"),
            real_time=True,
        )
        self.folder = folder
        self.server: Any = None
        self._fault: dict = {}
        self._failed: float | None = None
        self._held: np.ndarray | None = None

    def start(self) -> None:
        path = self.folder / "fault.json"
        self._fault = json.loads(path.read_text()) if path.exists() else {}
        self._failed = self._held = None
        super().start()
        (self.folder / "started").touch()
        (self.folder / "running").touch()

    def fetch(self) -> np.ndarray:
        before = self._fetched
        block = super().fetch().copy()
        fault, rate = self._fault, self.bench.sample_rate
        if not fault or self._fetched < fault["at"] * rate:
            return block
        first = max(int(fault["at"] * rate) - before, 0)
        row = self._inputs.index("ideal")
        if self._failed is None:
            self._failed = time.monotonic()
            (self.folder / "fault.json").unlink(missing_ok=True)
            if fault["kind"] == "late":
                time.sleep(fault["seconds"])
            if fault["kind"] == "gone":
                assert self.server is not None
                self.server.drop()
        if fault["kind"] == "nan":
            block[row, first:] = np.nan
        elif fault["kind"] == "jump":
            block[row, first:] += 1e-3
        elif fault["kind"] == "frozen":
            self._held = block[row, first] if self._held is None else self._held
            block[row, first:] = self._held
        return block

    def stop(self, slew: float) -> None:
        if not self._running:
            return
        asked, fetched = time.monotonic(), self._fetched / self.bench.sample_rate
        super().stop(slew)
        times, volts = self.output()
        at = float(np.interp(fetched, times, volts))
        step = self.capabilities.step
        away = np.flatnonzero(np.abs(volts) > 1.5 * step)
        zero = float(times[away[-1]]) if away.size else 0.0
        updates = np.interp(np.arange(int(times[-1] * 20e3)) / 20e3, times, volts)
        line = {
            "stopped": asked,
            "began": self._began,
            "failed": self._failed,
            "fetched": fetched,
            "volts": at,
            "ramp": max(zero - fetched, 0.0),
            "end": float(volts[-1]),
            "least": float(volts.min()),
            "greatest": float(volts.max()),
            "slew": float(np.abs(np.diff(updates)).max(initial=0.0) * 20e3),
            "step": step,
            "slid": self.origin,
        }
        with (self.folder / "runs.jsonl").open("a") as file:
            file.write(json.dumps(line) + "\n")
        (self.folder / "running").unlink(missing_ok=True)


class Server:
    """The device's side of `far_rig`: one program at a time; when it goes, or is silent for too long while a
    run goes on, the output stops. Its cable can be pulled."""

    def __init__(self, rig: FailingRig) -> None:
        self._rig, self._gate = rig, Gate(rig, OWN, rig.capabilities)
        self._held = threading.Lock()
        self._link: socket.socket | None = None
        self._running = False

    def drop(self) -> None:
        """Pull the cable."""
        link = self._link
        if link is not None:
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)

    def serve(self, listening: socket.socket) -> None:
        """Until the process is ended."""
        while True:
            link, _ = listening.accept()
            threading.Thread(target=self._hold, args=(link,), daemon=True).start()

    def _hold(self, link: socket.socket) -> None:
        with link, suppress(OSError, EOFError):
            if not self._held.acquire(timeout=1.0):  # the one before may be about to leave
                return
            try:
                self._link = link
                while True:
                    link.settimeout(OWN.watchdog if self._running else None)
                    asked, values = receive(link)
                    try:
                        send(link, *self._done(asked, values))
                    except RigError as error:
                        send(link, {"error": str(error)})
            finally:
                self._stop()
                self._link = None
                self._held.release()

    def _done(self, asked: dict[str, Any], values: np.ndarray) -> tuple[dict[str, Any], np.ndarray | None]:
        do, block = asked["do"], None
        if do == "load":
            self._gate.load(values)
        elif do == "arm":
            self._rig.arm(tuple(asked["inputs"]), asked["samples"])
        elif do == "start":
            self._gate.start()
            self._running = True
        elif do == "fetch":
            block = self._rig.fetch()
        elif do == "stop":
            self._rig.stop(max(asked["slew"], OWN.max_voltage / LONGEST_STOP))
            self._running = False
        return {"capabilities": self._rig.capabilities._asdict(), "origin": self._rig.origin}, block

    def _stop(self) -> None:
        if self._running:
            self._running = False
            self._gate.stop()


def main(folder: Path) -> None:
    """Serve until the process is ended."""
    rig = FailingRig(folder)
    rig.server = Server(rig)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        (folder / "port").write_text(str(listening.getsockname()[1]))
        rig.server.serve(listening)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
