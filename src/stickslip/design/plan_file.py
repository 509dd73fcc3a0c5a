"""A plan as an experiment file for `stickslip record`."""

from __future__ import annotations

import json
import math
import os
import re
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..identify.walk.experiments import PlannedWalk
from ..parameters import available_sets
from ..parameters.writing import parameter_text, write_parameters
from ..physics.actuator import Actuator, load_actuator
from ..quantities.input_file import load_yaml, yaml_text
from ..quantities.units import QuantityError, to_si
from ..recording.drive import drive_text
from ..recording.replacing import replaced_whole
from ..rig import Limits
from ..rig.experiment.running import check_experiment
from ..waveform import Sequence as Parts
from ..waveform.signal import Waveform
from .information import BEFORE

if TYPE_CHECKING:
    from .plan import Plan

_LONGEST_NAME = 40


def save_plan(
    plan: Plan,
    path: str | os.PathLike[str],
    *,
    like: str | os.PathLike[str] | None = None,
    before: float | str = BEFORE,
) -> Path:
    """Write a plan as an experiment file, and return its path.

    Args:
        plan: result of `plan_experiment`.
        path: the new file, .yaml.
        like: an experiment file whose rig, channels, variables and actuator are taken, but not its runs. By
            default: the virtual bench of [kang2007] with the plan's actuator. The actuator's parameters go to
            a parameter set beside the file, NAME_actuator.toml, if the file cannot contain them.
        before: duration of rest before each drive, s, which becomes the pre-trigger time of each recording.

    Raises:
        QuantityError: a waveform cannot be written to a file, `like` has no channel end_effector_position, or
            `like` is missing for a rotary actuator.
        InputFileError: `like` is no experiment file.
        FileExistsError: the file, or the parameter set beside it, exists.
    """
    path, before = Path(path), to_si(before, "s", "before")
    if like is None and plan.model.rotary:
        raise QuantityError("like: an actuator that turns needs an experiment file whose rig gives its angle")
    example = files("stickslip") / "examples" / "kang2007_experiment.yaml"
    content = load_yaml(Path(str(example)) if like is None else like)
    check_experiment(content, like or "the example")
    if path.exists():
        raise FileExistsError(f"{path} exists")
    if "end_effector_position" not in content["channels"]:
        raise QuantityError(f"{like}: it has no channel end_effector_position, which the plan is for")
    goal = "all parameters" if plan.goal == "all" else plan.goal
    runs = [_run(i, name, walk, before) for i, (name, walk) in enumerate(plan.recordings.items(), start=1)]
    content |= {
        "title": f"Planned for {goal}",
        "notes": plan.report().partition("\n")[0],
        "limits": content.get("limits", {}) | _limits(plan.limits),
        "runs": runs,
    }
    if like is None:
        content |= {"actuator": _actuator(plan.model, path), "variables": {}}
    check_experiment(content, path)
    with replaced_whole(path) as whole:
        whole.write_text("# stickslip record FILE --out DIR\n" + yaml_text(content), encoding="utf-8")
    return path


def _run(number: int, name: str, walk: PlannedWalk, before: float) -> dict[str, Any]:
    parts = walk.drive.parts if isinstance(walk.drive, Parts) else ((walk.drive, math.inf),)
    slug = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")[:_LONGEST_NAME]
    return {
        "name": f"plan_{number}_{slug}",
        "notes": name,
        "waveform": [_part(waveform, length) for waveform, length in parts],
        "capture": {
            "length": round(walk.duration + before, 9),
            "interval": 1.0 / walk.sample_rate,
            "pre_trigger": before,
        },
        "repeats": walk.repeats,
    }


def _part(waveform: Waveform, length: float) -> dict[str, Any]:
    data = json.loads(drive_text(waveform))
    name = data.pop("waveform")
    if isinstance(waveform, Parts) or any(key.startswith("waveform") for key in data):
        raise QuantityError(
            f"{name}: a file says only known waveforms, one after the other; give those instead"
        )
    own = waveform.duration
    more = {} if math.isinf(length) or math.isclose(own, length, rel_tol=1e-12) else {"duration": length}
    return {"shape": name, "fields": data} | more


def _limits(limits: Limits) -> dict[str, float]:
    kept = ("min_voltage", "max_voltage", "max_slew", "max_duty", "min_position", "max_position")
    return {name: getattr(limits, name) for name in kept if math.isfinite(getattr(limits, name))}


def _actuator(model: Actuator, path: Path) -> dict[str, Any]:
    """Return the section `actuator` of an experiment file, which describes a model.

    If the model differs from a parameter set of the package only by finite numbers and flags, the section has
    the keys "set" (name), "change" and "friction" (changed values by field, SI). Otherwise a new parameter
    set is written beside `path`, the path of the experiment file, and "set" names that file.
    """
    if model.name in available_sets():
        known = load_actuator(model.name)
        if type(known.friction) is type(model.friction) and known.piezo == model.piezo:
            changed = {k: v for k, v in model._asdict().items() if v != getattr(known, k)}
            friction = changed.pop("friction", model.friction)._asdict()
            different = {k: v for k, v in friction.items() if v != getattr(known.friction, k)}
            plain = all(isinstance(v, bool | float) for v in (*changed.values(), *different.values()))
            if plain and all(math.isfinite(v) for v in (*changed.values(), *different.values())):
                return {"set": model.name, "change": changed, "friction": different}
    text = parameter_text(model, f"Actuator of the plan {path.stem}", "what the experiment was planned with")
    return {"set": write_parameters(path.with_name(f"{path.stem}_actuator.toml"), text).name}
