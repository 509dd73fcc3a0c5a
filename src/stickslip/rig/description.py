"""Descriptions of rigs as JSON, from which the rig's process opens a device."""

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
    """Describe a virtual rig; `bench` is a name or the path of a file."""
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
    """Describe a rig whose back end has a registered name, with its options."""
    return {"kind": "own", **registry.rigs.written(rig_type), "options": options}


def open_device(device: dict[str, Any], origin: float) -> Rig:
    """Open the rig of a description; `origin` is the previous displacement of a virtual end-effector, m.

    Raises:
        RigError: nobody answers there, or the description has no known kind.
        ValueError: a value in it is wrong.
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
    """Return attributes for a recording of `runs` runs of a device; see `Repeats.told`."""
    if device.get("kind") != "virtual":
        return {}
    return Repeats.of_document(device.get("repeats", {})).told(_actuator(device), runs, after)


def _actuator(device: dict[str, Any]) -> Actuator:
    fields = dict(device["actuator"])
    if fields.get("normal_force"):
        fields["normal_force"] = NormalForce(*fields["normal_force"])
    return Actuator(friction=registry.laws.of_client(device)(**fields.pop("friction")), **fields)
