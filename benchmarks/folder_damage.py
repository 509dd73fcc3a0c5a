"""Folders of a lab with random damage to names, bytes, JSON, YAML, links and times: see `folder_fuzz`."""

from __future__ import annotations

import json
import os
import shutil
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import stickslip as ss
from stickslip.recording import save_csv, save_matlab
from stickslip.study import Grid, Own, Study

from .folder_study import value

Random = np.random.Generator

EXPERIMENT = """\
kind: experiment
title: A walk
rig: {kind: virtual, bench: kang2007-bench}
runs:
  - name: walk
    waveform: [{shape: Sawtooth, fields: {amplitude: 65 V, frequency: 5 Hz, periods: 2}}]
    capture: {length: 0.5 s, down_sampling: 1}
"""
TEXTS = ("notes.json", "links.json", "shown.json", "results.json")  # of a fit
SUFFIXES = (".nc", ".csv", ".mat", ".npz")


class Made(NamedTuple):
    """Content of a folder: names of good runs; damaged entries, and whether each is surely bad (others may be
    readable still); kinds of damage; damage of the study's store, "" for none."""

    good: set[str]
    damaged: dict[str, bool]
    kinds: list[str]
    store: str


def templates(folder: Path) -> Path:
    """Make one good file of each kind; return the folder."""
    clock = np.arange(60) / 1e3
    made = ss.make_recording(
        clock,
        {"drive_voltage": (65.0 * (clock * 50.0 % 1.0), "V"), "end_effector_position": (1e-6 * clock, "m")},
        title="A walk",
        notes="of a template",
        source="virtual rig kang2007-bench",
    )
    made.attrs["capture"] = json.dumps({"length": 0.06, "interval": 1e-3, "pre_trigger": 0.0})
    made.attrs["variables"] = json.dumps({"voltage": "65 V"})
    ss.save_recording(made, folder / "run.nc")
    save_csv(made, folder / "run.csv")
    save_matlab(made, folder / "run.mat", "trace")
    np.savez(folder / "run.npz", time=clock, drive_voltage=clock)
    fit = folder / "fit"
    fit.mkdir()
    (fit / "report.html").write_text("<html></html>")
    numbers = {"r_squared": 0.98, "parameters": {"sigma_0": {"value": 1e6, "unit": "N/m"}}}
    (fit / "results.json").write_text(json.dumps({"title": "Fit", "summary": "good", "numbers": numbers}))
    (fit / "notes.json").write_text(json.dumps({"notes": "mine", "tags": "a, b"}))
    (fit / "links.json").write_text(json.dumps({"kind": "fit", "links": {"fitted": ["run.nc"]}}))
    request = {"recordings": ["run.nc"], "set": "kang2007", "law": "LuGre", "free": []}
    (fit / "shown.json").write_text(json.dumps({"phase": "done", "request": request}))
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    study = Study(Grid({"x": np.arange(4.0), "y": np.arange(3.0)}), Own(value), task=3)
    ss.run_study(study, folder / "s.zarr", workers=1)
    return folder


def build(folder: Path, source: Path, seed: int) -> Made:
    """Make the folder of a seed from templates: some good runs, and damaged entries between them."""
    draw = np.random.default_rng(seed)
    folder.mkdir()
    good, damaged, kinds = set[str](), dict[str, bool](), list[str]()
    for i in range(int(draw.integers(2, 5))):
        place = folder / ["", "runs", "runs/deep/er"][int(draw.integers(3))]
        place.mkdir(parents=True, exist_ok=True)
        good.add(_good(draw, source, place, i, folder))
    for i in range(int(draw.integers(3, 8))):
        kind = list(DAMAGE)[int(draw.integers(len(DAMAGE)))]
        place = folder / ["", "bad", "bad/more"][int(draw.integers(3))]
        place.mkdir(parents=True, exist_ok=True)
        kinds.append(kind)
        name, surely = DAMAGE[kind](draw, source, place, i)
        if name:
            damaged[os.path.relpath(os.path.join(place, name), folder)] = surely
    _beside(draw, source, folder, kinds)
    return Made(good, damaged, kinds, _store(draw, source, folder))


def _good(draw: Random, source: Path, place: Path, i: int, root: Path) -> str:
    if draw.random() < 0.25:
        path = Path(shutil.copytree(source / "fit", place / f"fit {i}"))
    else:
        suffix = SUFFIXES[int(draw.integers(len(SUFFIXES)))]
        path = Path(shutil.copy(source / f"run{suffix}", place / f"gut_{i}_µ{suffix}"))
    return path.relative_to(root).as_posix()


def _name(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A good recording under a bad name."""
    names = (b"Pr\xfcfung%d.nc", b"line\n%d.nc", b"back\\slash%d.nc", b"\xff\xfe%d.nc", b"\x1b[2J%d.nc")
    name = names[int(draw.integers(len(names)))] % i
    shutil.copy(source / "run.nc", place / os.fsdecode(name))
    return os.fsdecode(name), True


def _odd_name(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A good recording under an odd name that is allowed."""
    names = ("CON.nc", " .nc", 200 * "n" + ".nc", "e\u0301.nc", "'; DROP TABLE runs; --.nc", "%00.NC")
    name = f"{i}" + names[int(draw.integers(len(names)))]
    shutil.copy(source / "run.nc", place / name)
    return name, False


def _bytes(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A recording with bytes changed, cut, added or of another file."""
    suffix = SUFFIXES[int(draw.integers(len(SUFFIXES)))]
    data, surely = bytearray((source / f"run{suffix}").read_bytes()), False
    how = int(draw.integers(6))
    if how == 0:
        for at in draw.integers(len(data), size=int(draw.integers(1, 40))):
            data[at] = int(draw.integers(256))
    elif how == 1:
        data, surely = data[: int(draw.integers(len(data) // 3))], suffix != ".csv"
    elif how == 2:
        at = int(draw.integers(len(data)))
        data[at : at + 64] = bytes(64)
    elif how == 3:
        data = bytearray(draw.bytes(int(draw.integers(1, 3000))))
        surely = True
    elif how == 4:
        at = int(draw.integers(len(data)))
        data[at:at] = draw.bytes(16)
    else:
        at = int(draw.integers(len(data) - 8))  # a length or an address
        data[at : at + 8] = (2**64 - 1, 2**63, 2**32, 2**31 - 1)[int(draw.integers(4))].to_bytes(8, "little")
    (place / f"bytes{i}{suffix}").write_bytes(data)
    return f"bytes{i}{suffix}", surely


BAD_JSON: tuple[str, ...] = (
    "[" * 100_000, '{"a":' * 5000, '{"title": "\\ud800"}', "", "nul", "{} {}", '{"a": 1, "a": 2}',
    "[" + "1," * 1_000_001 + "1]", '{"numbers": ' + "9" * 5000 + "}", "\x00\x01", "5", "[]", '"text"', "null",
    '{"numbers": 5}', '{"links": 5}', '{"links": {"of": 5}}', '{"links": {"of": [5]}}', '{"request": []}',
    '{"request": {"recordings": 5}}', '{"failures": {"a": []}}', '{"numbers": {"x": NaN, "y": Infinity}}',
    '{"title": {"a": [1, 2]}, "tags": 5, "notes": null, "kind": []}',
)  # fmt: skip


def _json(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A fit with one bad file."""
    fit = Path(shutil.copytree(source / "fit", place / f"json{i}"))
    file = fit / TEXTS[int(draw.integers(len(TEXTS)))]
    if draw.random() < 0.3:
        data = bytearray(file.read_bytes())
        for at in draw.integers(len(data), size=int(draw.integers(1, 6))):
            data[at] = int(draw.integers(256))
        file.write_bytes(data)
        return fit.name, False
    which = int(draw.integers(len(BAD_JSON)))
    file.write_text(BAD_JSON[which])
    return fit.name, which < 10


_LAUGHS = "a: &a [x]\n" + "".join(
    f"{b}: &{b} [{','.join(['*' + a] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
BAD_YAML: tuple[str, ...] = (
    "[" * 50_000, "kind: study\n" + "a: " + "{b: " * 5000, _LAUGHS, "kind: experiment\nx: 1" + ":59" * 20_000,
    "kind: study\n<<: [{a: 1}, {b: 2}]\n", "!!python/object/apply:os.system ['true']\n", "\x00",
    "\udced\udca0", "kind: study\nkind: study\n", "? [a, b]\n: 5\n",
)  # fmt: skip


def _yaml(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A file that pages of the panel offer; it is none of the history."""
    text = BAD_YAML[int(draw.integers(len(BAD_YAML)))]
    if draw.random() < 0.3:
        text = EXPERIMENT[: int(draw.integers(len(EXPERIMENT)))] + text[:100]
    (place / f"bad{i}.yaml").write_bytes(text.encode("utf-8", "surrogateescape"))
    return "", False


def _link(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A link to itself, to nothing, out of the folder, or what never answers."""
    path, how = place / f"link{i}.nc", int(draw.integers(7))
    if how == 0:
        path.symlink_to(path.name)
    elif how == 1:
        path.symlink_to("/etc/passwd")
    elif how == 2:
        path.symlink_to("nowhere.nc")
    elif how == 3:
        os.mkfifo(path)
    elif how == 4:
        with socket.socket(socket.AF_UNIX) as made:  # by a short name: that of a socket has a limit
            here = os.open(".", os.O_RDONLY)
            os.chdir(place)
            made.bind(path.name)
            os.fchdir(here)
            os.close(here)
    elif how == 5:
        path.symlink_to(source / "run.nc")
    else:
        fit = Path(shutil.copytree(source / "fit", place / f"link{i}"))
        file = fit / TEXTS[int(draw.integers(2))]
        file.unlink()
        file.symlink_to([file.name, "/etc/passwd", "nowhere"][int(draw.integers(3))])
        return fit.name, True
    return path.name, True


def _loop(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """Links to folders, which are not followed, and folders that are deep within each other."""
    if draw.random() < 0.7:
        (place / f"loop{i}").symlink_to(["..", ".", f"loop{i}", "/etc"][int(draw.integers(4))])
    else:
        (place / f"deep{i}" / "/".join("d" * 120)).mkdir(parents=True)
    return "", False


def _time(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A good recording of a time beyond calendars."""
    path = Path(shutil.copy(source / "run.nc", place / f"time{i}.nc"))
    when = int(draw.choice([0, -(10**9), 10**10, 2**33, 253402300800, 2**40, -(2**40)]))
    try:
        os.utime(path, ns=(when * 10**9, when * 10**9 + int(draw.integers(10**9))))
    except (OverflowError, OSError):
        os.utime(path, (0, 0))
    return path.name, False


def _attribute(draw: Random, source: Path, place: Path, i: int) -> tuple[str, bool]:
    """A whole recording with bad texts in its attributes."""
    import h5py

    path = Path(shutil.copy(source / "run.nc", place / f"attr{i}.nc"))
    name = ("title", "links", "capture", "variables", "notes", "epoch", "actuator")[int(draw.integers(7))]
    values: list[Any] = ["[" * 60_000, '{"of": 5}', "\ud800", "x" * 50_000, 5.0, np.arange(9), b"\xff", "{}"]
    with h5py.File(path, "r+") as file:
        value = values[int(draw.integers(len(values)))]
        if isinstance(value, str):
            value = np.bytes_(value.encode("utf-8", "surrogatepass"))
        file.attrs[name] = value
    return path.name, False


DAMAGE: dict[str, Callable[[Random, Path, Path, int], tuple[str, bool]]] = {
    "name that cannot be shown": _name,
    "odd name": _odd_name,
    "bytes of a recording": _bytes,
    "attribute of a recording": _attribute,
    "JSON of a fit": _json,
    "YAML": _yaml,
    "link, pipe or socket": _link,
    "link to a folder, deep folders": _loop,
    "time": _time,
}


def _beside(draw: Random, elsewhere: Path, folder: Path, kinds: list[str]) -> None:
    """Damage what the package itself keeps in a folder: the list of acts, alarms, the index."""
    line = json.dumps({"time": "2026-01-05", "act": "renamed", "name": "b.nc", "was": "a.nc"}) + "\n"
    text = BAD_JSON[int(draw.integers(len(BAD_JSON)))]
    bad = line + text[:200_000] + "\n" + line
    kept = folder / ".stickslip"
    if draw.random() < 0.4:
        (folder / "acts.jsonl").write_text(bad)
        kinds.append("list of acts")
    if draw.random() < 0.3:
        kept.mkdir()
        (kept / "alarms.json").write_text(text)
        kinds.append("alarms")
    if draw.random() < 0.3:
        kept.mkdir(exist_ok=True)
        (kept / "runs.sqlite").write_bytes(draw.bytes(int(draw.integers(5000))))
        kinds.append("index")
    if draw.random() < 0.1:
        shutil.rmtree(kept, ignore_errors=True)
        kept.symlink_to(elsewhere)
        kinds.append("index")


def _store(draw: Random, source: Path, folder: Path) -> str:
    """Copy the store of a study, and damage one of its files; return what was done."""
    store = Path(shutil.copytree(source / "s.zarr", folder / "s.zarr"))
    if draw.random() < 0.2:
        return ""
    files = sorted(one for one in store.rglob("*") if one.is_file() and not one.name.startswith("."))
    file = files[int(draw.integers(len(files)))]
    how = ("gone", "cut", "bit", "swapped", "fifo")[int(draw.integers(5))]
    data = file.read_bytes()
    if how == "swapped":
        others = [one for one in files if one.name == file.name and one.read_bytes() != data]
        other = others[int(draw.integers(len(others)))] if others else files[0]
        file.write_bytes(other.read_bytes())
        other.write_bytes(data)
    elif how == "cut":
        file.write_bytes(data[: int(draw.integers(len(data)))])
    elif how == "bit":
        at = int(draw.integers(len(data)))
        file.write_bytes(data[:at] + bytes([data[at] ^ (1 << int(draw.integers(8)))]) + data[at + 1 :])
    else:
        file.unlink()
        if how == "fifo":
            os.mkfifo(file)
    return f"{how}: {file.relative_to(store)}"
