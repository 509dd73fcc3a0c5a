"""A small experiment that runs in a few milliseconds, to be varied by the tests."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import yaml

SMALL: dict[str, Any] = {
    "title": "Small",
    "operator": "T. Est",
    "notes": "short",
    "rig": {"kind": "virtual", "seed": 1},
    "channels": {
        "drive_voltage": {"input": "drive"},
        "end_effector_position": {
            "input": "inductive",
            "calibration": ["kang2007-inductive-5"],
            "filter": {"order": 2, "corner": "2 kHz"},
            "zero": True,
        },
    },
    "variables": {"temperature": "296 K"},
    "runs": [
        {
            "name": "walk",
            "matrix": {"voltage": ["35 V", "65 V"], "frequency": ["50 Hz", 100.0]},
            "repeats": 2,
            "waveform": [
                {"shape": "Sawtooth", "fields": {"amplitude": "$voltage", "frequency": "$frequency"}}
            ],
            "capture": {
                "length": "40 ms",
                "interval": "0.5 ms",
                "pre_trigger": "5 ms",
                "trigger": {"signal": "drive_voltage", "level": "2 V"},
            },
        }
    ],
}
NAMES = {f"walk_{v}_{f}_{r}" for v in ("35V", "65V") for f in ("50Hz", "100") for r in (1, 2)}


def changed(path: str, value: Any) -> dict[str, Any]:
    """The small experiment with one thing changed: "runs.0.capture.length"; None takes it away."""
    content = copy.deepcopy(SMALL)
    *owners, last = path.split(".")
    node: Any = content
    for key in owners:
        node = node[int(key)] if isinstance(node, list) else node[key]
    if value is None:
        del node[last]
    else:
        node[int(last) if isinstance(node, list) else last] = value
    return content


def written(folder: Path, content: Any) -> Path:
    """The content as a YAML file in the folder."""
    path = folder / "experiment.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path
