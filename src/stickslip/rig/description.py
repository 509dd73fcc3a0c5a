"""Descriptions of rigs as JSON data, from which the process that owns a rig opens the device.

A description is a dictionary with a `kind`: "virtual" for a simulated rig, "own" for a real one.
"""

from __future__ import annotations

from typing import Any

from ..friction import NormalForce
from ..physics.actuator import Actuator
from ..quantities import registry
from .bench import load_bench
from .protocols import Rig, RigError
from .variation import EXACT, Repeats
from .virtual import VirtualRig


def virtual_device(
    actuator: Actuator, bench: str, seed: int, real_time: bool, repeats: Repeats = EXACT
) -> dict[str, Any]:
    """Return the description of a virtual rig as JSON data.

    Args:
        actuator: the simulated actuator.
        bench: name of a bench, or path of its file.
        seed: seed of the noise.
        real_time: True to deliver the samples no sooner than a real rig would.
        repeats: variation of the contact from run to run, and irregularity of the steps; by default neither.
    """
    fields = actuator._asdict()
    return {
        "kind": "virtual",
        "bench": bench,
        "seed": seed,
        "real_time": real_time,
        "repeats": repeats.document(),
        **registry.laws.written(type(actuator.friction)),
        "actuator": {**fields, "friction": actuator.friction._asdict()},
    }


def own_device(rig_type: type, options: dict[str, Any]) -> dict[str, Any]:
    """Return the description of a real rig as JSON data.

    Args:
        rig_type: registered class of the rig, of the package or a user's own.
        options: arguments of its constructor, by name; JSON data.
    """
    return {"kind": "own", **registry.rigs.written(rig_type), "options": options}


def open_device(device: dict[str, Any], origin: float) -> Rig:
    """Open the rig that a description names, and return it.

    Args:
        device: description, as `virtual_device` or `own_device` returns it.
        origin: displacement of the end-effector by all earlier runs, m (rad), from which a virtual rig
            continues; a real rig ignores it.

    Raises:
        RigError: the device does not answer, or the description has no known kind.
        ValueError, LookupError, TypeError: a value of the description is wrong, missing or unknown.
    """
    kind = device.get("kind")
    if kind == "own":
        return registry.rigs.of_client(device)(**device["options"])
    if kind != "virtual":
        raise RigError(f"{kind!r} is no kind of rig: virtual or own")
    made = VirtualRig(
        _actuator(device),
        load_bench(str(device["bench"])),
        seed=int(device["seed"]),
        repeats=Repeats.of_document(device.get("repeats", {})),
        real_time=bool(device["real_time"]),
    )
    made.origin = origin
    return made


def told_of(device: dict[str, Any], runs: int, after: int) -> dict[str, str]:
    """Return attributes for a recording, texts by name: the true contact in its runs (`Repeats.told`).

    The result is empty for a real rig, and for a virtual rig whose contact does not vary.

    Args:
        device: description of the rig.
        runs: number of runs of the recording.
        after: number of runs that the rig has made since the run `number` in the description's `repeats`.
    """
    if device.get("kind") != "virtual":
        return {}
    return Repeats.of_document(device.get("repeats", {})).told(_actuator(device), runs, after)


def _actuator(device: dict[str, Any]) -> Actuator:
    fields = dict(device["actuator"])
    if fields.get("normal_force"):
        fields["normal_force"] = NormalForce(*fields["normal_force"])
    return Actuator(friction=registry.laws.of_client(device)(**fields.pop("friction")), **fields)
