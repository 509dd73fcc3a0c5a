"""Rigs that the Bench page offers: virtual benches, back ends, connected devices."""

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
_MOST = 50  # number of the folder's newest .toml files in which benches are sought
_LONGEST = 2000  # characters of options that are read


def offered(folder: Folder) -> dict[str, Any]:
    """Return the rigs to choose from and the connected devices; nothing is sent to any device."""
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
            continue  # a parameter set, or a damaged file
        yield name


def _options(kind: str) -> str:
    """Return the arguments of a back end (driver) as text to edit: "name: default, ..."."""
    given = inspect.signature(registry.rigs.find(kind)).parameters.values()
    return ", ".join(f"{one.name}: {'' if one.default is one.empty else one.default}" for one in given)


def asked_rig(kind: str, bench: str, options: str, before: Content) -> Content:
    """Return the section "rig" of an experiment file for the chosen rig.

    Args:
        kind: "virtual", or the name of a back end.
        bench: the virtual rig's bench.
        options: the back end's arguments as text, such as "host: 192.168.0.20".
        before: the section so far; a virtual rig that stays virtual keeps its settings.
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
    """Return the experiment with the channels and runs that a rig supports, and a list of what was left out.

    Args:
        content: the experiment, with the new rig.
        can: the rig's capabilities.
        check: raises ValueError or RigError for a content that cannot be recorded.

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
    """Return capabilities, unit of positions from home, and finite limits of the experiment, in SI."""
    return {
        **can._asdict(),
        "unit": unit,
        "limits": {name: value for name, value in limits._asdict().items() if math.isfinite(value)},
        "safe_state": "ramp to 0 V" if about is None else about.safe_state,
        "verified": "" if about is None else about.verified,
    }
