"""What is asked of a trial of the fault study, and how it is judged by what an observer saw."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fault_device import LOOK, OWN, WATCHED
from stickslip.history.index import Index
from stickslip.recording import open_recording
from stickslip.recording.readers.process import Reader
from stickslip.rig.samples import recover

WATCHDOG = 0.4  # s
GAIN = 0.1057e-6  # m/V of the actuator
BLOCK = 0.02  # s in which a fault is seen
STALLED = 0.6  # s that a process stalls beyond the watchdogs; then it goes on, and notices itself
GRACE = 0.25  # s for the processes of a machine that does other things besides
FAULTS = (
    "program killed", "program stalls", "program frozen", "rig's process killed", "rig's process stalls",
    "rig's process frozen", "nan", "frozen", "jump", "drift", "sign", "cable", "late", "gone", "disk full",
    "clock set back", "second operator", "stop", "permit withdrawn", "none",
)  # fmt: skip
SENSOR = ("nan", "frozen", "jump", "drift", "sign", "cable", "late", "gone")
# A drive that is known beforehand goes on with these: no reading of the sensor contradicts the limits.
UNSEEN = ("drift", "sign", "cable")
# After these a device that holds its voltage cannot be reached: people must be told.
UNREACHED = ("rig's process killed", "rig's process frozen", "gone", "late")
LOUD = "switch the amplifier off"
READER = Reader()  # reads the files for History
# What has to pass until somebody notices, s, besides a block.
NOTICED = {
    "program stalls": WATCHDOG,
    "program frozen": WATCHDOG,
    "rig's process frozen": OWN.watchdog,
    "rig's process stalls": OWN.watchdog,
    "rig's process killed": 0.0,
    "frozen": 0.1,
    "late": WATCHDOG + 1.0,  # a connection that says nothing so long is closed
}


class Metronome:
    """A thread that wants to run every 2 ms; `longest` is by how much it was late, s. A computer that gives
    it no time gives none to what it measures."""

    def __init__(self) -> None:
        self.longest, self._over = 0.0, threading.Event()
        self._thread = threading.Thread(target=self._beat)

    def __enter__(self) -> Metronome:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        before = time.monotonic()
        while not self._over.wait(LOOK):
            now = time.monotonic()
            self.longest, before = max(self.longest, now - before - LOOK), now


def judge(
    fault: str,
    struck: float | None,
    runs: list[dict[str, Any]],
    limits: dict[str, Any],
    holds: bool = False,
    stalled: float = 0.0,
) -> tuple[float | None, list[str]]:
    """How late 0 V came, and what was wrong with the output. For `stalled` s the computer gave the study no
    time."""
    wrong, late = [], None
    for one in runs:
        half = 0.5 * one["step"] + 1e-6
        if one["greatest"] > limits["max_voltage"] + half or one["least"] < -half:
            wrong.append(f"the output went from {one['least']:.3f} to {one['greatest']:.3f} V")
        if one["slew"] > limits["max_slew"] + one["step"] * 20e3:
            wrong.append(f"the output changed at {one['slew']:.3g} V/s")
        if abs(one["end"]) > one["step"]:
            wrong.append(f"the output ended at {one['end']:.3f} V")
        stated = abs(one["volts"]) / min(limits["stop_slew"], OWN.stop_slew) + 2e-3
        if one["ramp"] > stated + one["step"] / limits["stop_slew"]:
            wrong.append(f"the ramp from {one['volts']:.2f} V took {one['ramp']:.4f} s")
        began = one["failed"] if fault in SENSOR else struck
        if began is not None and fault not in UNSEEN and one["began"] <= began <= one["stopped"]:
            late = one["stopped"] - began
            resting = STALLED if holds and fault == "rig's process stalls" else 0.0
            if late > NOTICED.get(fault, 0.0) + resting + 2 * BLOCK + GRACE + stalled:
                wrong.append(f"the ramp began {late:.3f} s after the fault")
    return late, wrong


def last_seen(folder: Path) -> float:
    """The output that was seen last, V."""
    data = (folder / "watched.bin").read_bytes()
    whole = len(data) // WATCHED.size * WATCHED.size
    return float(WATCHED.unpack(data[whole - WATCHED.size : whole])[1]) if whole else 0.0


def watched(folder: Path, fault: str, limits: dict[str, Any], late: float) -> tuple[float, list[str]]:
    """What the observer saw: steps beyond the end stop, and what was wrong."""
    data = (folder / "watched.bin").read_bytes()
    whole = len(data) // WATCHED.size * WATCHED.size
    _, volts, at = np.frombuffer(data[:whole], "<f8").reshape(-1, 3).T
    wrong = []
    if volts.size and (volts.max() > limits["max_voltage"] + 0.1 or volts.min() < -0.1):
        wrong.append(f"the output was seen at {volts.min():.2f} to {volts.max():.2f} V")
    step = GAIN * limits["amplitude"]
    far = float(at.max(initial=0.0)) if (folder / "homed").exists() else 0.0
    beyond = max((far - limits["max_position"]) / step, 0.0)
    # Steps that are made while a block comes in and a busy machine looks at it.
    allowed = 1.0 + limits["frequency"] * (2 * BLOCK + GRACE + late)
    if fault not in UNSEEN and beyond > allowed:
        wrong.append(f"the end-effector was {beyond:.2f} steps beyond its end stop")
    return beyond, wrong


def kept(out: Path, runs: list[dict[str, Any]], disk: bool) -> tuple[int, int, list[str]]:
    """Recordings that are whole, those that are not and are listed, and what is wrong with either."""
    wrong = []
    if not out.exists():
        return 0, 0, ["runs without a folder"] if any(one["fetched"] > 0 for one in runs) else []
    recover(out)
    whole, rest = list(out.glob("*.nc")), list(out.glob("unfinished/*.nc"))
    for path in (*whole, *rest):
        outcome = open_recording(path).attrs["outcome"]
        if (outcome == "complete") != (path in whole):
            wrong.append(f"{path.name}: {outcome}")
    # Two blocks on their way may be lost, and the first 10 ms are for filters to settle.
    begun = sum(one["fetched"] > 0.1 for one in runs)
    if disk and begun > len(whole) + len(rest):
        wrong.append(f"{begun} runs, {len(whole)} recordings and {len(rest)} unfinished ones")
    if list(out.glob(".*.samples")) and disk:
        wrong.append("samples are left that belong to nothing")
    with Index(out, READER) as index:  # what a person finds afterwards
        listed = [one for one in index.rows() if one["outcome"]]
    if len(listed) < len(whole) + len(rest):
        wrong.append(f"History lists {len(listed)} of {len(whole) + len(rest)} runs with their outcome")
    return len(whole), len(rest), wrong
