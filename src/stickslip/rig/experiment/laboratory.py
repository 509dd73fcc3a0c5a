"""Laboratories: sources of the rigs that record an experiment file, in this or in another process."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from typing import Any, ClassVar, Protocol

from ...physics.actuator import Actuator, load_actuator
from ...physics.electronics import OutputStage
from ...quantities import registry
from .. import (
    Bench,
    Capabilities,
    Home,
    HostedRig,
    Link,
    Repeats,
    Rig,
    RigError,
    VirtualRig,
    folder_of,
    load_bench,
)
from ..description import own_device, virtual_device
from ..variation import EXACT
from .file import ExperimentFile, OwnRigSpec, VirtualRigSpec


class Laboratory(Protocol):
    """Source of the rigs that record the cells (recordings) of an experiment file.

    `home` is the common origin of positions of all recordings; a `HostedRig` uses the home of its process.
    """

    home: Home

    def capabilities(self, actuator: Actuator) -> Capabilities:
        """Return the capabilities of the rig for a recording with this actuator, without any output."""
        ...

    def rig(self, actuator: Actuator, seed: int, repeats: Repeats = EXACT) -> Rig:
        """Return the rig that records a cell. A real rig is the same for all cells.

        Args:
            actuator: the actuator of the cell, which a virtual rig simulates.
            seed: seed of a virtual rig's noise.
            repeats: variation of a virtual rig's contact, and number of its next run.
        """
        ...

    def close(self) -> None:
        """Release the rig, so that other programs can use it."""
        ...


class VirtualLaboratory:
    """Laboratory with a new virtual rig for each cell, all on one bench, computed in this process.

    With `real_time` True the rigs deliver samples no sooner than a real rig would.
    """

    def __init__(self, bench: Bench, real_time: bool = False) -> None:
        self._bench, self._real_time = bench, real_time
        self.home = Home()
        self._last: VirtualRig | None = None

    def capabilities(self, actuator: Actuator) -> Capabilities:
        """Return the capabilities of the bench."""
        return VirtualRig(actuator, self._bench).capabilities

    def rig(self, actuator: Actuator, seed: int, repeats: Repeats = EXACT) -> Rig:
        """Return a new virtual rig, whose end-effector starts where the previous one has ended."""
        made = VirtualRig(actuator, self._bench, seed=seed, repeats=repeats, real_time=self._real_time)
        if self._last is not None:
            made.origin = self._last.origin
        self._last = made
        return made

    def close(self) -> None:
        """Do nothing: a rig in this process needs no release."""


class HostedVirtualLaboratory:
    """Laboratory with a virtual rig for each cell, in a process of their own, which several clients may
    share.

    Args:
        bench: the bench of all rigs.
        name: name or path of this bench, from which the process loads it.
        real_time: True to deliver samples no sooner than a real rig would.
        link: connection to the process.
        own: folder of the process if only this laboratory uses it, which `close` then removes; None for a
            shared process.
    """

    def __init__(self, bench: Bench, name: str, real_time: bool, link: Link, own: Path | None = None) -> None:
        self._bench, self._name, self._real_time, self._link, self._own = bench, name, real_time, link, own
        self.home = Home()

    def capabilities(self, actuator: Actuator) -> Capabilities:
        """Return the capabilities of the bench."""
        return VirtualRig(actuator, self._bench).capabilities

    def rig(self, actuator: Actuator, seed: int, repeats: Repeats = EXACT) -> Rig:
        """Return the rig that records a cell, which the process opens when its first run starts."""
        device = virtual_device(actuator, self._name, seed, self._real_time, repeats)
        return HostedRig(self._link, device, self.capabilities(actuator))

    def close(self) -> None:
        """Close the connection, and remove the folder of the process if only this laboratory used it."""
        self._link.close()
        if self._own is not None:
            shutil.rmtree(self._own, ignore_errors=True)


class RealLaboratory:
    """Laboratory with one real rig for all cells, owned by a process of its own.

    The actuator, seed and variation of a cell do not change the rig. The rig is opened once for its
    capabilities and released until something is recorded.

    Args:
        device: description of the rig, see `description`.
        link: connection to the process.

    Raises:
        RigError: the rig does not answer, or another program holds it.
    """

    def __init__(self, device: dict[str, Any], link: Link) -> None:
        self._device, self._link = device, link
        self.home = Home()
        opened = HostedRig(link, self._device)
        self._can, self._said = opened.capabilities, opened.told(1)
        opened.stop(0.0)  # there is no run: this releases the rig for other programs

    def capabilities(self, actuator: Actuator) -> Capabilities:
        """Return the capabilities of the rig, which do not depend on the actuator."""
        del actuator
        return self._can

    def rig(self, actuator: Actuator, seed: int, repeats: Repeats = EXACT) -> Rig:
        """Return the rig, which is the same for all cells; the arguments are ignored."""
        del actuator, seed, repeats
        return HostedRig(self._link, self._device, self._can, self._said)

    def close(self) -> None:
        """Close the connection to the process."""
        self._link.close()


def open_laboratory(
    file: ExperimentFile, folder: Path, rigs: Path | None = None, who: str = ""
) -> Laboratory:
    """Open the laboratory of an experiment file.

    A rig that puts out voltages in real time belongs to a process of its own. A virtual rig that is computed
    as fast as possible stays in this process, unless `rigs` is given.

    Args:
        file: the experiment file's content.
        folder: folder of the file, for the paths in it.
        rigs: folder of the process that owns a virtual rig, which then never runs in this process. By
            default a virtual rig in real time gets a new folder. A real rig has its own folder.
        who: name of this program, shown to others who find the rig in use; by default it has the user's name.

    Raises:
        ParameterSetError: the bench cannot be read.
        RegistryError: there is no such kind of rig.
        RigError: the process or the rig does not answer, or another program holds the rig.
    """
    who = who or f"a program of {os.environ.get('USER', 'somebody')}"
    if not isinstance(file.rig, VirtualRigSpec):
        device, place = _device(file.rig, folder)
        link = Link(place, who)
        try:
            return RealLaboratory(device, link)
        except RigError:
            link.close()
            raise
    named = str(own_file(file.rig.bench, folder, ".toml"))
    bench = load_bench(named)
    if rigs is None and not file.rig.real_time:
        return VirtualLaboratory(bench)
    own = Path(tempfile.mkdtemp(prefix="stickslip-rig-")) if rigs is None else None
    link = Link(own or rigs or Path(), who)
    return HostedVirtualLaboratory(bench, named, file.rig.real_time, link, own)


def _device(rig: OwnRigSpec, folder: Path) -> tuple[dict[str, Any], Path]:
    """Return the description of a real rig (see `description`) and the folder of the process that owns it.

    `folder` is the folder of the experiment file, for a user's own rig.
    """
    made = own_device(registry.rigs.find(rig.kind, folder), rig.options)
    return made, folder_of(" ".join([made["rig"], *(f"{k}={v}" for k, v in sorted(rig.options.items()))]))


def rigs_of(file: ExperimentFile, virtual: Path, folder: Path) -> Path:
    """Return the folder of the process that owns the rig of an experiment file.

    Args:
        file: the experiment file's content.
        virtual: the folder to return if the rig is virtual.
        folder: folder of the experiment file, for a user's own back end beside it.
    """
    return virtual if isinstance(file.rig, VirtualRigSpec) else _device(file.rig, folder)[1]


class PlanningLaboratory:
    """Laboratory of an experiment file that only plans: it knows the capabilities but opens no rig to record.

    A real rig is opened briefly for its capabilities, once for each rig in the lifetime of the program.
    Errors are those of `open_laboratory`.
    """

    _known: ClassVar[dict[str, Capabilities]] = {}

    def __init__(self, file: ExperimentFile, folder: Path) -> None:
        self.home = Home()
        if not isinstance(file.rig, VirtualRigSpec):
            self._bench, resource = None, str(_device(file.rig, folder)[1])
            if resource not in self._known:
                asked = open_laboratory(file, folder, None, "the panel")
                try:
                    self._known[resource] = asked.capabilities(load_actuator("kang2007"))
                finally:
                    asked.close()
            self._can = self._known[resource]
        else:
            self._bench = load_bench(own_file(file.rig.bench, folder, ".toml"))

    def capabilities(self, actuator: Actuator) -> Capabilities:
        """Return the capabilities of the rig for a recording with this actuator."""
        return self._can if self._bench is None else VirtualRig(actuator, self._bench).capabilities

    def output(self) -> OutputStage:
        """Return the output stage for the design of drives.

        For a virtual rig it is that of the bench. For a real rig only update rate and voltage step are known.
        """
        if self._bench is not None:
            return self._bench.output()
        return OutputStage(self._can.update_rate, step=self._can.step)

    def rig(self, actuator: Actuator, seed: int, repeats: Repeats = EXACT) -> Rig:
        """Raise RigError, because this laboratory only plans."""
        raise RigError("this laboratory only plans")

    def close(self) -> None:
        """Do nothing: this laboratory holds no rig."""


def own_file(name: str, folder: Path, suffix: str) -> str | Path:
    """Return the path of `name` in `folder` if the name ends in `suffix`, such as ".toml"; else the name.

    A name without the ending is that of an object of the package, such as a bench.
    """
    return folder / name if name.endswith(suffix) else name
