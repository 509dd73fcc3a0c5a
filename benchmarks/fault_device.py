"""The device of the fault study: the virtual rig in real time, behind a socket in a process of its own.

It fails when it is told to. What came out of its amplifier, and where the end-effector truly was, is written
down. A run at 0 V sets home; it does not fail.

python -m benchmarks.fault_device FOLDER [holds]

By default the device stops by itself when its program is gone or silent, as one with a watchdog does. One
that `holds` does not: as an output card, it keeps its last voltage.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.gate.priority import come_first
from stickslip.physics.actuator import load_actuator
from stickslip.rig import Gate, Limits, RigError, VirtualRig, load_bench
from stickslip.rig.limits import LONGEST_STOP
from stickslip.rig.virtual import BLOCK
from stickslip.rig.wire import receive, send

# What the device allows by itself; a program's limits are narrower.
OWN = Limits(min_voltage=0.0, max_voltage=150.0, watchdog=0.5, stop_slew=1000.0)


WATCHED = struct.Struct("<ddd")  # s of the monotonic clock, V, m from home
LOOK = 2e-3  # s between what is watched
DRIFT = 500e-6  # m/s of a sensor that drifts


class FailingRig(VirtualRig):
    """Fails as the file `fault.json` says, in one run after it was written; each run is a line of
    `runs.jsonl`. Output and true position are in `watched.bin`, whatever becomes of the run."""

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
        self._home = 0.0
        self._true = np.zeros(1)  # m from where the run began, at each sample
        self._ramp_from = (0.0, 0.0, 1.0, 0.0)  # when the last ramp began, V, s that it takes, m
        threading.Thread(target=self._watch, daemon=True).start()

    def _now(self) -> tuple[float, float]:
        """Output, V, and true position, m, now."""
        now = time.monotonic()
        if self._running and self._true.size > 1:
            block = max(1, round(BLOCK * self.bench.sample_rate))
            played = min(int((now - self._began) * self.bench.sample_rate), self._fetched + block)
            k = min(max(played, 0), self._true.size - 1)
            return float(self._volts[min(k, self._volts.size - 1)]), self.origin + float(self._true[k])
        began, volts, seconds, at = self._ramp_from
        left = max(1.0 - (now - began) / max(seconds, 1e-9), 0.0)
        return volts * left, at - self.actuator.gain * volts * (1.0 - left)

    def _watch(self) -> None:
        """What an independent observer with an oscilloscope and an interferometer sees."""
        while True:
            with suppress(OSError):
                file = os.open(self.folder / "watched.bin", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
                try:
                    volts, at = self._now()
                    os.write(file, WATCHED.pack(time.monotonic(), volts, at - self._home))
                finally:
                    os.close(file)
            if (self.folder / "off").exists():  # a person switches the amplifier off
                self.stop(1e9)
                self.server.off()
                (self.folder / "off").unlink(missing_ok=True)
            time.sleep(LOOK)

    def _computed(self) -> np.ndarray:
        data = super()._computed()
        self._true = data[self._inputs.index("ideal")].copy() if "ideal" in self._inputs else np.zeros(2)
        return data

    def start(self) -> None:
        path = self.folder / "fault.json"
        self._failed, self._held, self._fault = None, None, {}
        if not self._volts.any():
            self._home = self.origin
            super().start()
            (self.folder / "watched.bin").unlink(missing_ok=True)
            (self.folder / "homed").touch()
            return
        self._fault = json.loads(path.read_text()) if path.exists() else {}
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
        elif fault["kind"] == "drift":
            block[row, first:] += DRIFT / rate * (before + first + np.arange(block.shape[1] - first))
        elif fault["kind"] == "sign":
            block[row, first:] *= -1.0
        elif fault["kind"] == "cable":
            block[row, first:] = 20e-9 * np.random.default_rng(before).standard_normal(block.shape[1] - first)
        return block

    def stop(self, slew: float) -> None:
        if not self._running:
            return
        asked, fetched = time.monotonic(), self._fetched / self.bench.sample_rate
        last = min(self._fetched, self._true.size) - 1
        here = self.origin + float(self._true[max(last, 0)])
        before = float(self._volts[min(max(last, 0), self._volts.size - 1)])
        self._ramp_from, self._true = (asked, before, abs(before) / slew, here), np.zeros(1)
        super().stop(slew)
        if not self._volts.any():
            return
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

    def __init__(self, rig: FailingRig, holds: bool) -> None:
        self._rig, self._gate, self._holds = rig, Gate(rig, OWN, rig.capabilities), holds
        self._held = threading.Lock()
        self._link: socket.socket | None = None
        self._running = False

    def off(self) -> None:
        """The amplifier was switched off: the next program finds a device at rest."""
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
                    link.settimeout(OWN.watchdog if self._running and not self._holds else None)
                    asked, values = receive(link)
                    try:
                        send(link, *self._done(asked, values))
                    except RigError as error:
                        send(link, {"error": str(error)})
            finally:
                if not self._holds:
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


def main(folder: Path, holds: bool) -> None:
    """Serve until the process is ended."""
    come_first(-15)  # a device is not slowed by what a computer does
    rig = FailingRig(folder)
    rig.server = Server(rig, holds)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        (folder / "port").write_text(str(listening.getsockname()[1]))
        rig.server.serve(listening)


if __name__ == "__main__":
    main(Path(sys.argv[1]), "holds" in sys.argv[2:])
