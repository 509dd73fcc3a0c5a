"""Rigs that the Bench page offers: virtual benches, back ends (drivers), and connected devices."""

from __future__ import annotations

import copy
import inspect
import math
from collections.abc import Callable, Iterator
from typing import Any

from ..parameters import ParameterSetError
from ..quantities import registry
from ..quantities.input_file import InputFileError, yaml_mapping
from ..quantities.registry import RegistryError, nothing_run
from ..quantities.units import QuantityError
from ..rig import About, Capabilities, Limits, RigError, available_benches, load_bench
from ..rig.attached import attached_devices, known_devices
from ..rig.measurement import DRIVE, POSITION
from .folder import Folder

Content = dict[str, Any]
_MOST = 50  # number of newest .toml files of the folder that are searched for benches
_LONGEST = 2000  # largest length of the options that is read, characters


def offered(folder: Folder) -> dict[str, Any]:
    """Return the rigs to choose from, "rigs", and the devices found on this machine's ports, "connected".

    An entry of "rigs" has "kind" and, for a virtual rig, "bench" and "device" (its name); otherwise "options"
    (see `_options`) and the fields of `rig.About`. An entry of "connected" has the fields of a device, see
    `rig.attached`. Nothing is sent to any device.
    """
    benches = [*available_benches(), *_own_benches(folder)]
    return {
        "rigs": [
            *({"kind": "virtual", "bench": name, "device": f"virtual rig, {name}"} for name in benches),
            *(
                {"kind": one.name, "options": _options(one.name), **one.about._asdict()}
                for one in known_devices()
                if one.kind == "rig" and one.name != "virtual"
            ),
        ],
        "connected": [one._asdict() for one in attached_devices()],
    }


def _own_benches(folder: Folder) -> Iterator[str]:
    for name, *_ in folder.files(".toml")[:_MOST]:
        try:
            with nothing_run():
                load_bench(folder.path(name))
        except (ParameterSetError, QuantityError, RegistryError, OSError):
            continue  # the file is a parameter set, or damaged
        yield name


def _options(kind: str) -> str:
    """Return the arguments of a back end (driver) with their defaults, as text to edit: "name: default, ...".

    `kind` is the back end's name.
    """
    given = inspect.signature(registry.rigs.find(kind)).parameters.values()
    return ", ".join(f"{one.name}: {'' if one.default is one.empty else one.default}" for one in given)


def asked_rig(kind: str, bench: str, options: str, before: Content) -> Content:
    """Return the content of the section "rig" of an experiment file for the chosen rig.

    Args:
        kind: "virtual", or the name of a back end.
        bench: name of the virtual rig's bench, not used for a back end.
        options: arguments of the back end as text, such as "host: 192.168.0.20", not used for a virtual rig;
            those without a value are left out.
        before: present content of the section; a virtual rig that stays virtual keeps its other settings.

    Raises:
        QuantityError: `options` cannot be read.
    """
    if kind == "virtual":
        kept = (
            before if before.get("kind", "virtual") == "virtual" else {"kind": "virtual", "real_time": True}
        )
        return {**kept, "bench": bench}
    try:
        made = yaml_mapping("{" + options[:_LONGEST] + "}", "options")
    except InputFileError:
        said = f"options = {options[:60]!r} must be like host: 192.168.0.20, interval: 100 us"
        raise QuantityError(said) from None
    return {"kind": kind, "options": {k: v for k, v in made.items() if v is not None}}


def fitted(
    content: Content, can: Capabilities, check: Callable[[Content], object]
) -> tuple[Content, list[str]]:
    """Return an experiment reduced to what a rig supports, and a text for each channel and run left out.

    If a channel was left out, a channel is added for each input of the rig that has none. The displays of the
    page are reduced to the remaining variables.

    Args:
        content: content of the experiment file, with the new rig.
        can: capabilities of the rig.
        check: takes a content; raises ValueError or RigError if it cannot be recorded.

    Raises:
        QuantityError: the rig supports none of the runs.
    """
    content = copy.deepcopy(content)
    said = [f"channel {name}" for name, one in content["channels"].items() if one["input"] not in can.inputs]
    kept = {name: one for name, one in content["channels"].items() if one["input"] in can.inputs}
    for name, unit in can.inputs.items():
        if name not in {one["input"] for one in kept.values()}:
            wanted = "drive_voltage" if name == DRIVE else POSITION if unit in ("m", "rad") else name
            if wanted not in kept:
                kept[wanted] = {"input": name}
    content["channels"] = kept if said else content["channels"]
    runs = []
    for run in content["runs"]:
        try:
            check({**content, "runs": [run], "panel": []})
            runs.append(run)
        except (ValueError, RigError) as error:
            said.append(f"run {run['name']}: {error}")
    if not runs:
        raise QuantityError("; ".join(said))
    known = {*content["channels"], *content.get("variables", {}), "position"}
    content["runs"], panel = runs, []
    for one in content.get("panel", []):
        left = [name for name in one["variables"] if name in known or one["kind"] == "input"]
        panel += [{**one, "variables": left}] if left else []
    return {**content, "panel": panel}, said


def facts(can: Capabilities, limits: Limits, about: About | None, unit: str) -> dict[str, Any]:
    """Return the facts on a rig that pages show, in SI.

    Keys: the fields of `Capabilities`, "unit" of positions from home, and "limits", the finite limits of the
    experiment by name. "safe_state" is how the output reaches its safe state. "verified" is the reference
    against which the back end was verified, "" for a virtual rig, whose `about` is None.
    """
    return {
        **can._asdict(),
        "unit": unit,
        "limits": {name: value for name, value in limits._asdict().items() if math.isfinite(value)},
        "safe_state": "ramp to 0 V" if about is None else about.safe_state,
        "verified": "" if about is None else about.verified,
    }
