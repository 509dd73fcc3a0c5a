"""A panel's folder with an actuator that turns, and an experiment on a bench that reads its angle."""

from __future__ import annotations

from pathlib import Path

import yaml

from rotary.turning import BENCH, TURNS
from stickslip.panel.document import DEFAULT
from stickslip.parameters.writing import parameter_text, write_parameters
from stickslip.quantities.input_file import load_yaml

SET, EXPERIMENT = "parameters/rotary.toml", "turning.yaml"


def prepare(folder: Path, **rig: object) -> None:
    """Write the parameter set, the bench and the experiment: the panel's own, but for those."""
    path = folder / SET
    path.parent.mkdir()
    write_parameters(path, parameter_text(TURNS, "a rotary stage", "measured"))
    (folder / "bench.toml").write_text(BENCH, encoding="utf-8")
    content = load_yaml(DEFAULT)
    content["rig"] |= {"bench": "bench.toml", **rig}
    content["actuator"]["set"] = SET
    content["channels"] = {
        "drive_voltage": {"input": "drive"},
        "end_effector_position": {"input": "encoder", "zero": True},
    }
    content["limits"] |= {"min_position": "-200 mrad", "max_position": "200 mrad"}
    content["panel"] = [
        {"kind": "display", "variables": ["end_effector_position", "position"], "width": 12},
        {
            "kind": "plotter",
            "variables": ["drive_voltage", "end_effector_position"],
            "width": 12,
            "height": 6,
        },
    ]
    (folder / EXPERIMENT).write_text(yaml.safe_dump(content), encoding="utf-8")
