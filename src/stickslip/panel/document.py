"""The experiment on the bench: content of an experiment file, checked as a whole at every change.

The content of a file here is the mapping that its YAML text describes.
"""

from __future__ import annotations

import copy
import math
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ..parameters import available_sets
from ..physics.actuator import Actuator
from ..quantities import registry
from ..quantities.input_file import load_yaml, yaml_text
from ..quantities.places import place_of
from ..quantities.records import quantities, quantities_of
from ..quantities.registry import nothing_run
from ..quantities.units import ANGLE, QuantityError, to_si, unit_for
from ..recording import STANDARD_NAMES
from ..recording.calibration.storage import available_calibrations
from ..recording.readers.process import Reader
from ..recording.replacing import replaced_whole
from ..rig import Capabilities, Limits
from ..rig.bench import available_benches
from ..rig.experiment.cells import Cell, cells, limits_of
from ..rig.experiment.file import ExperimentFile, VirtualRigSpec
from ..rig.experiment.laboratory import PlanningLaboratory
from ..rig.experiment.running import check_experiment
from ..rig.measurement import channel_units
from .folder import Folder
from .rigs import asked_rig, facts, fitted

DEFAULT = Path(__file__).parent / "experiment.yaml"
MOST_KEPT = 200  # largest number of changes that can be undone
_KEY_LIMIT = 8  # largest number of keys and indices in a path to a value


class Checked(NamedTuple):
    """Checked content of an experiment file, and the results of the check.

    Attributes:
        content: content of the file, a mapping as in YAML.
        file: the same content as a record.
        cells: recordings to make: one for each run, repeat and combination of the values in the run's matrix.
        units: unit of each recorded channel, by name.
        can: capabilities of the rig.
        limits: limits of output and position, from the file.
    """

    content: dict[str, Any]
    file: ExperimentFile
    cells: list[Cell]
    units: dict[str, str]
    can: Capabilities
    limits: Limits

    @property
    def unit(self) -> str:
        """Return the unit of positions from home: m, or rad for rotary actuators."""
        return unit_for(self.cells[0].actuator, "m")


class BenchDocument:
    """The experiment on the bench, with its earlier states for undo; at first the content of `DEFAULT`.

    `name` is the name of its file in the panel's folder, "" if it was never saved. `checked` is its present
    content.
    """

    def __init__(self, folder: Folder, read: Reader) -> None:
        self._folder, self._read = folder, read
        self.name = ""
        # Called before the limits of the output and the position change, with the old and the new limits. An
        # exception from it refuses the change.
        self.limits_change: Callable[[Limits, Limits], None] = lambda before, after: None
        self._lock = threading.Lock()  # held during a change, so that changes are applied one after the other
        self._before: list[Checked] = []
        self._undone: list[Checked] = []
        self.checked = self._check(load_yaml(DEFAULT))

    def _check(self, content: dict[str, Any]) -> Checked:
        """Return the checked content. Nothing is put out, and no new Python file of the user is run.

        Raises ValueError or RigError if the content cannot be recorded.
        """
        with nothing_run():
            file, laboratory = self._planned(content)
            found = cells(file, self._folder.root, laboratory, self._read)
            can = laboratory.capabilities(found[0].actuator)
        limits = limits_of(file.limits, found[0].actuator)
        return Checked(content, file, found, channel_units(can, found[0].channels, limits), can, limits)

    def _planned(self, content: dict[str, Any]) -> tuple[ExperimentFile, PlanningLaboratory]:
        """Return the content as a record, and a laboratory that only knows the rig's capabilities.

        Raises ValueError if the content is wrong, or names a file outside the panel's folder.
        """
        file = check_experiment(content)
        for name in _files(file):
            self._folder.path(name)
        return file, PlanningLaboratory(file, self._folder.root)

    def check(self, content: dict[str, Any]) -> Checked:
        """Check a content without putting it on the bench, and return it with the results of the check.

        Raises ValueError or RigError if the content cannot be recorded.
        """
        return self._check(content)

    def change(self, path: list[str | int], value: Any) -> None:
        """Set one value in the content; a `value` of None deletes its key in a mapping.

        `path` lists the keys and the indices (from 0) of lists that lead to the value. Raises the errors of
        `replace`, and QuantityError if there is no such place; then nothing is changed.
        """
        with self._lock:
            self._take(self._check(self._changed(path, value)))

    def choose_rig(self, kind: str, bench: str, options: str) -> list[str]:
        """Move the experiment to another rig; return a text for each channel and run that was left out.

        The new rig does not have these channels, or cannot record these runs. The arguments are those of
        `bench.Chosen`. Raises the errors of `replace`; then nothing is changed.
        """
        with self._lock:
            content = self.checked.content
            content = {**content, "rig": asked_rig(kind, bench, options, content.get("rig", {}))}
            with nothing_run():
                _, laboratory = self._planned(content)
                can = laboratory.capabilities(self.checked.cells[0].actuator)
            made, left_out = fitted(content, can, self._check)
            self._take(self._check(made))
            return left_out

    def _take(self, made: Checked) -> None:
        """Put a checked content on the bench, as a change that can be undone; an unchanged one is ignored."""
        if made.content != self.checked.content:
            self._ask(made)
            self._before = [*self._before, self.checked][-MOST_KEPT:]
            self.checked, self._undone = made, []

    def _ask(self, made: Checked) -> None:
        """Call `limits_change` if the new content has other limits; an exception refuses the change."""
        if made.limits != self.checked.limits:
            self.limits_change(self.checked.limits, made.limits)

    def undo(self, again: bool = False) -> bool:
        """Undo the last change, or with `again` redo the change last undone.

        Returns False if there is nothing to undo or redo. An exception from `limits_change` refuses it.
        """
        with self._lock:
            source, target = (self._undone, self._before) if again else (self._before, self._undone)
            if not source:
                return False
            self._ask(source[-1])
            target.append(self.checked)
            self.checked = source.pop()
            return True

    def _changed(self, path: list[str | int], value: Any) -> dict[str, Any]:
        content = copy.deepcopy(self.checked.content)
        if not 0 < len(path) <= _KEY_LIMIT:
            raise QuantityError("a change names a place in the experiment")
        place, key = place_of(content, path)
        if value is None and isinstance(place, dict):
            place.pop(key, None)
        else:
            place[key] = value
        return content

    def replace(self, content: dict[str, Any], name: str) -> None:
        """Put another experiment on the bench, without a way to undo this.

        Args:
            content: content of the experiment file.
            name: name of the file in the panel's folder.

        Raises:
            ValueError, RigError: the experiment cannot be recorded, or the user may not change the limits.
        """
        with self._lock:
            made = self._check(content)
            self._ask(made)
            self.checked, self.name = made, name
            self._before, self._undone = [], []

    def load(self, name: str) -> None:
        """Load the experiment file `name` of the panel's folder; raises the errors of `replace`."""
        self.replace(load_yaml(self._folder.path(name)), name)

    def save(self, name: str) -> None:
        """Save the experiment as the file `name` of the panel's folder, which becomes the experiment's name.

        An existing file is replaced as a whole, at once. Raises QuantityError unless the name ends with
        .yaml, FolderError for another wrong name, and OSError.
        """
        if not name.endswith(".yaml"):
            raise QuantityError(f"{name[:60]!r}: an experiment file is called NAME.yaml")
        path = self._folder.path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced_whole(path) as temporary:
            temporary.write_text(yaml_text(self.checked.content), encoding="utf-8")
        self.name = name

    def of_runs(self, names: list[str]) -> dict[str, Any]:
        """Return the content with only the named runs; QuantityError for an unknown or missing name."""
        runs = [run for run in self.checked.content["runs"] if run["name"] in names]
        if not runs or len(runs) < len(set(names)):
            raise QuantityError(f"there is no run {', '.join(names) or 'chosen'}")
        return {**self.checked.content, "runs": runs}

    def described(self) -> dict[str, Any]:
        """Return the data of the experiment that pages show, in JSON types.

        Keys: "rig" (see `rigs.facts`), "name" of the file, "content", "panel" (displays and plotters),
        "channels" (name, unit and label of each), "variables" (see `_variables`), and "undo" and "redo", True
        if there is something to undo or redo.
        """
        content, file, _, units, can, limits = self.checked
        virtual = isinstance(file.rig, VirtualRigSpec)
        back_end = None if virtual else registry.rigs.find(file.rig.kind, self._folder.root)
        return {
            "rig": facts(can, limits, getattr(back_end, "about", None), self.checked.unit),
            "name": self.name,
            "content": content,
            "panel": [one.model_dump() for one in file.panel],
            "channels": [_channel(name, unit) for name, unit in units.items()],
            "variables": list(self._variables()),
            "undo": bool(self._before),
            "redo": bool(self._undone),
        }

    def _variables(self) -> Iterator[dict[str, Any]]:
        """Yield a dictionary for every number that an input field of the page can set.

        Keys: "name", "value" in SI, "unit", "label", "path" (keys that lead to the value in the content, see
        `change`), and "kind", the part of the experiment: "experiment", "actuator", "friction" or "rig".
        """
        file, found = self.checked.file, self.checked.cells
        for name, value in file.variables.items():
            unit = _unit_of(name, value)
            if unit is not None and not isinstance(value, bool):
                yield _variable(name, to_si(value, unit, name), unit, "", ["variables", name], "experiment")
        actuator: Actuator = found[0].actuator
        for name, quantity in quantities_of(actuator).items():
            value = getattr(actuator, name)
            if isinstance(value, float) and math.isfinite(value):
                place = ["actuator", "change", name]
                yield _variable(name, value, quantity.unit, quantity.meaning, place, "actuator")
        for name, quantity in quantities_of(actuator.friction, actuator).items():
            value = getattr(actuator.friction, name)
            if isinstance(value, float) and math.isfinite(value):
                place = ["actuator", "friction", name]
                yield _variable(f"friction.{name}", value, quantity.unit, quantity.meaning, place, "friction")
        if isinstance(file.rig, VirtualRigSpec):
            variation = found[0].repeats.variation
            for name, quantity in quantities(type(variation)).items():
                value, place = getattr(variation, name), ["rig", "variation", name]
                yield _variable(f"variation.{name}", value, quantity.unit, quantity.meaning, place, "rig")


def _files(file: ExperimentFile) -> Iterator[str]:
    """Yield the names of the user's files in an experiment: parameter set, bench, calibrations, waveforms.

    The caller checks that they are in the panel's folder. Names of the package's own sets, benches and
    calibrations are left out.
    """
    bench = getattr(file.rig, "bench", "")
    named = [(bench, available_benches()), (file.actuator.set, available_sets())]
    known = available_calibrations()
    named += [(name, known) for channel in file.channels.values() for name in channel.calibration]
    yield from (name for name, package in named if name and name not in package)
    yield from (part.file for run in file.runs for part in run.waveform if part.file is not None)


def _channel(name: str, unit: str) -> dict[str, str]:
    standard = STANDARD_NAMES.get(name)
    return {"name": name, "unit": unit, "label": standard.long_name if standard else name.replace("_", " ")}


def _variable(
    name: str, value: float, unit: str, meaning: str, place: list[str], kind: str
) -> dict[str, Any]:
    label = meaning or name.replace("_", " ")
    return {"name": name, "value": value, "unit": unit, "label": label, "path": place, "kind": kind}


_SLIDING = ("V", "Hz", "s", "m", "N", "kg", "", "N/m", "V/s", "m/s", "N s/m")
_VARIABLES = tuple(dict.fromkeys([*_SLIDING, *map(ANGLE.unit, _SLIDING)]))


def _unit_of(name: str, value: Any) -> str | None:
    """Return the SI unit of the value of a variable, "" for a number.

    None: the value is a text that is not a quantity in any of the units `_VARIABLES`. `name` is the
    variable's name, for errors.
    """
    if isinstance(value, int | float):
        return ""
    # A text with "rad" or "deg" has an angle in its unit. The unit library treats a radian as a plain number:
    # without this test it would read 5 mN m as a rotary stiffness, and 3 % as an angle.
    turns = re.search("rad|deg", value) is not None
    for unit in (one for one in _VARIABLES if ("rad" in one) == turns):
        try:
            to_si(value, unit, name)
        except QuantityError:
            continue
        return unit
    return None
