"""Simulated recordings for users without recordings, with which a new input file runs at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...physics.actuator import load_actuator
from ...recording.replacing import replaced_whole
from ...simulation import simulate
from ...waveform.periodic import Sawtooth
from ...waveform.sequence import Sequence
from ...waveform.shapes import Rest, Step

# REST: time before the drive starts, s. NOISE: standard deviation of the position's noise, m.
REST, NOISE = 0.1, 20e-9
# _WALKS: sample rate, Hz, of each walk by its amplitude, V. _STEP: amplitude of the clamped step, V.
_WALKS, _STEP = {65.0: 4e3, 75.0: 4e3}, 60.0


def example_files(beside: Path, step: bool) -> list[Path]:
    """Return the paths of the example recordings: a clamped step if `step` is True, then two walks.

    `beside` is the path of the new input file. The examples are CSV files in its folder, with names that
    start with its name.
    """
    names = [f"walk-{volts:g}V" for volts in _WALKS]
    names = [f"step-{_STEP:g}V", *names] if step else names
    return [beside.with_name(f"{beside.stem}-example-{name}.csv") for name in names]


def write_examples(beside: Path, step: bool) -> list[Path]:
    """Simulate and write the example recordings of `example_files` for the new file `beside`, with a step if
    `step`; return their paths.

    Existing files would be replaced; the caller must check for them before.
    """
    files = example_files(beside, step)
    noise = np.random.default_rng(2007)
    hidden = load_actuator("kang2007")
    runs = [(hidden, Sawtooth(volts, 20.0, periods=8), rate, 0.6) for volts, rate in _WALKS.items()]
    if step:
        runs.insert(0, (hidden.replace(clamped=True), Step(_STEP), 20e3, 0.2))  # type: ignore[arg-type]
    for file, (model, wave, rate, length) in zip(files, runs, strict=True):
        drive = Sequence(Rest(REST), (wave, length - REST))
        time = np.arange(round(length * rate)) / rate
        moved = simulate(model, drive, times=time)["end_effector_position"].values
        moved = moved + NOISE * noise.standard_normal(time.size)
        table = np.column_stack([1e3 * time, 1e6 * moved, drive.value(time)])
        with replaced_whole(file) as temporary, temporary.open("w", encoding="utf-8") as writing:
            np.savetxt(writing, table, "%.5f", ",", header="t [ms],x [um],u [V]", comments="")
    return files
