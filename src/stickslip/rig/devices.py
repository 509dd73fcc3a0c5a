"""What a rig is made of, as JSON, so that a client can name it to the process that is to own it."""

from __future__ import annotations

from typing import Any

from ..actuator import Actuator
from ..friction import LAWS
from ..units import QuantityError
from .bench import load_bench
from .protocols import Rig, RigError
from .scpi import ScpiRig
from .virtual import VirtualRig


def virtual_device(actuator: Actuator, bench: str, seed: int, real_time: bool) -> dict[str, Any]:
    """A virtual rig; `bench` is a name or the path of a file."""
    fields = actuator._asdict()
    return {
        "kind": "virtual",
        "bench": bench,
        "seed": seed,
        "real_time": real_time,
        "law": type(actuator.friction).__name__,
        "actuator": {**fields, "friction": actuator.friction._asdict()},
    }


def scpi_device(resource: str) -> dict[str, Any]:
    """A rig behind VISA."""
    return {"kind": "scpi", "resource": resource}


def open_device(device: dict[str, Any], origin: float) -> Rig:
    """The rig; `origin` is how far a virtual end-effector has come before, m.

    Raises:
        RigError: nobody answers there, or it is no device.
        ValueError: a value in it is wrong.
    """
    kind = device.get("kind")
    if kind == "scpi":
        return ScpiRig(str(device["resource"]))
    if kind != "virtual":
        raise RigError(f"{kind!r} is no kind of rig: virtual or scpi")
    laws = {law.__name__: law for law in LAWS}
    if device["law"] not in laws:
        raise QuantityError(f"the law {device['law']!r} is not known in the rig's process")
    fields = dict(device["actuator"])
    friction = laws[device["law"]](**fields.pop("friction"))
    made = VirtualRig(
        Actuator(**fields, friction=friction),
        load_bench(str(device["bench"])),
        seed=int(device["seed"]),
        real_time=bool(device["real_time"]),
    )
    made.origin = origin
    return made
