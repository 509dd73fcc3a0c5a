"""Limits and permits of a site (computer or laboratory), from a file; no panel or experiment can exceed them.

The environment variable STICKSLIP_SITE names the file; the default is /etc/stickslip/site.toml. The file is
read at each start of a run::

    [limits]                        # for every rig
    max_voltage = "120 V"

    [permits.door]                  # given by an input of the rig while its reading is within the bounds
    input = "door"
    minimum = "2 V"

    [permits.vacuum]                # given and withdrawn by people or by a program
    reason = "the chamber is below 1e-3 mbar"

    [rigs.nv200-host-192.168.0.20.limits]   # for one rig, by the folder of its process
    max_voltage = "60 V"

A simulated rig has no physical output: the file is not read for it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ..parameters import ParameterSetError, read_toml
from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError, optional_si, to_si, with_prefix
from .interlock import interlock_of
from .limits import LimitError, Limits, check_drive
from .protocols import Array, Capabilities, Rig, RigError

VARIABLE, DEFAULT = "STICKSLIP_SITE", Path("/etc/stickslip/site.toml")
# Function that returns the stricter of two values, and unit, by the name of each limit that a site can
# restrict.
_NARROWER = {
    "min_voltage": (max, "V"),
    "max_voltage": (min, "V"),
    "max_slew": (min, "V/s"),
    "max_duty": (min, ""),
    "min_position": (max, "m"),
    "max_position": (min, "m"),
    "watchdog": (min, "s"),
    "frozen": (min, "s"),
    "heartbeat": (min, "s"),
}
_TABLES = ("limits", "permits", "rigs")
_OF_PERMIT = ("input", "minimum", "maximum", "reason")


class InputPermit(NamedTuple):
    """Permit that an input of the rig gives while its reading is within `minimum` and `maximum`.

    The bounds are numbers in the unit of the input, or texts with a unit; None is no bound.
    """

    input: str
    minimum: float | str | None = None
    maximum: float | str | None = None

    def bounds(self, can: Capabilities) -> tuple[float, float]:
        """Return the lower and the upper bound in the unit of the input, infinite if not given.

        `can` are the capabilities of the rig, which state this unit.

        Raises:
            QuantityError: the rig has no such input, or a bound has another dimension.
        """
        if self.input not in can.inputs:
            said = f"a permit of the site needs the input {self.input!r}, which {can.name} does not have"
            raise QuantityError(said + did_you_mean(self.input, can.inputs))
        unit = can.inputs[self.input]
        low = optional_si(self.minimum, unit, "minimum")
        high = optional_si(self.maximum, unit, "maximum")
        return -math.inf if low is None else low, math.inf if high is None else high


class Site(NamedTuple):
    """Limits and permits of a site.

    `limits` are SI values by field of `Limits`, `inputs` the permits that inputs of the rig give, by name of
    the permit, and `permits` the names of the permits that people give. `path` is the file; None without one.
    """

    limits: Mapping[str, float] = {}
    inputs: Mapping[str, InputPermit] = {}
    permits: tuple[str, ...] = ()
    path: Path | None = None

    def narrowed(self, limits: Limits) -> Limits:
        """Return limits that are, field by field, the stricter of the given and the site's limits.

        The slew rate of a stop is reduced to the resulting `max_slew`.

        Raises:
            QuantityError: a ramp to 0 V would take longer than `LONGEST_STOP` within these limits.
        """
        given = {}
        for name, value in self.limits.items():
            given[name] = _NARROWER[name][0](getattr(limits, name), value)
        slew = given.get("max_slew", limits.max_slew)
        return Limits(**{**limits._asdict(), **given, "stop_slew": min(limits.stop_slew, slew)})

    def told(self) -> list[str]:
        """Return each limit and each permit that an input gives as a short text, for display; not the permits
        that people give."""
        words = [
            f"{name.replace('_', ' ')} {with_prefix(value, _NARROWER[name][1])}"
            for name, value in self.limits.items()
        ]
        for name, one in self.inputs.items():
            ends = [
                f"{sign} {end}" for sign, end in ((">=", one.minimum), ("<=", one.maximum)) if end is not None
            ]
            words.append(f"{name}: input {one.input} {' and '.join(ends)}")
        return words

    def check(self, volts: Array, limits: Limits, can: Capabilities) -> None:
        """Raise LimitError if the given limits or the site's forbid a drive.

        The message names the site and its file if only the site forbids the drive.

        Args:
            volts: voltages at the piezo, V, one per update [n].
            limits: limits of the experiment.
            can: capabilities of the rig.
        """
        try:
            check_drive(volts, self.narrowed(limits), can)
        except LimitError as error:
            check_drive(volts, limits, can)  # raises here if the experiment's own limits forbid the drive too
            raise LimitError(f"{error}; the limit is that of the site, {self.path}") from None

    def around(self, rig: Rig) -> Rig:
        """Return the rig in a `PermittedRig`, or the rig itself if no input gives a permit."""
        return PermittedRig(rig, self.inputs) if self.inputs else rig


class PermittedRig:
    """Wrapper of a rig that ends a run when the reading of an input is outside the bounds of its permit.

    The wrapper has the methods of `protocols.StreamingRig`, if the rig has them, and all other attributes of
    the rig.

    Args:
        rig: rig that outputs and records; the inputs of the permits are recorded in addition.
        permits: permits that inputs give, by name.

    Raises:
        QuantityError: as `InputPermit.bounds`.
    """

    def __init__(self, rig: Rig, permits: Mapping[str, InputPermit]) -> None:
        self._rig: Any = rig
        can = rig.capabilities
        self._permits = {name: (one.input, *one.bounds(can)) for name, one in permits.items()}
        self._asked = 0  # number of inputs that the user of this rig requested; they are recorded first
        self._read: tuple[str, ...] = ()
        if hasattr(rig, "begin"):  # such a rig is a `StreamingRig`, on which a loop can be closed
            self.begin, self.exchange = self._begin, self._exchange

    @property
    def capabilities(self) -> Capabilities:
        """Capabilities of the wrapped rig."""
        return self._rig.capabilities

    def __getattr__(self, name: str) -> Any:
        """Return the attribute `name` of the wrapped rig.

        AttributeError for `begin` and `exchange`, which would bypass the check of the permits.
        """
        if name in ("begin", "exchange"):
            raise AttributeError(name)
        return getattr(self._rig, name)

    @property
    def interlock(self) -> Any:
        """Interlock of the wrapped rig, see `interlock_of`."""
        return interlock_of(self._rig)

    def load(self, volts: Array) -> None:
        """Load the drive [n], V at the piezo, one value per update."""
        self._rig.load(volts)

    def arm(self, inputs: tuple[str, ...], samples: int) -> None:
        """Choose the inputs to record and the number of samples; inputs of the permits are recorded too."""
        self._rig.arm(self._with_permits(inputs), samples)

    def start(self) -> None:
        """Start the output and the recording."""
        self._rig.start()

    def fetch(self) -> Array:
        """Return the next samples [inputs, n] of the requested inputs, in their units.

        Raises:
            LimitError: the reading of an input is outside the bounds of its permit, or NaN.
        """
        block = self._rig.fetch()
        if block.shape[1]:
            self._check(block.min(axis=1).tolist(), block.max(axis=1).tolist())
        return block[: self._asked]

    def stop(self, slew: float) -> None:
        """Ramp to 0 V at `slew` [V/s] and end the recording."""
        self._rig.stop(slew)

    def _begin(self, inputs: tuple[str, ...]) -> list[float]:
        return self._checked(self._rig.begin(self._with_permits(inputs)))

    def _exchange(self, volts: float) -> list[float]:
        return self._checked(self._rig.exchange(volts))

    def _checked(self, readings: list[float]) -> list[float]:
        self._check(readings, readings)
        return readings[: self._asked]

    def _with_permits(self, inputs: tuple[str, ...]) -> tuple[str, ...]:
        more = dict.fromkeys(one for one, *_ in self._permits.values() if one not in inputs)
        self._asked, self._read = len(inputs), (*inputs, *more)
        return self._read

    def _check(self, least: list[float], greatest: list[float]) -> None:
        for name, (source, low, high) in self._permits.items():
            at = self._read.index(source)
            if not (least[at] >= low and greatest[at] <= high):  # also true for NaN
                reads = least[at] if not least[at] >= low else greatest[at]
                unit = self.capabilities.inputs[source]
                raise LimitError(
                    f"the permit {name!r} is withdrawn: the input {source!r} reads "
                    f"{with_prefix(reads, unit)}, not within {low:g} to {high:g} {unit}: stopped"
                )


def sited(rig: Rig, limits: Limits) -> tuple[Rig, Limits, Site]:
    """Apply the limits and permits of the site to a run of a rig in this program.

    A simulated rig and its limits are returned unchanged, with an empty site. So is a rig that another
    process owns: that process applies the site itself.

    The device's own limits are read again, and the interlock of the rig requires the permits that people
    give.

    Returns:
        The rig with checks of the permits that inputs give, the stricter limits, and the site.

    Raises:
        RigError, QuantityError: as `site_of`, `PermittedRig` and `Site.narrowed`.
    """
    if getattr(rig, "guard", None) is not None or getattr(rig, "simulated", False):
        return rig, limits, Site()
    site = site_of()
    refreshed(rig)
    interlock_of(rig).require(site.permits)
    return site.around(rig), site.narrowed(limits), site


def refreshed(rig: Any) -> None:
    """Call the rig's method `refresh`, if any, which reads limits that people may have changed at the
    device."""
    refresh = getattr(rig, "refresh", None)
    if refresh is not None:
        refresh()


def site_of(rig: str = "") -> Site:
    """Return the site's limits and permits from its file; empty without a file.

    Args:
        rig: name of the folder of the rig's process. Its own limits (the stricter ones count) and permits are
            included; "" for a rig without a process.

    Raises:
        RigError: the file is wrong, or the environment variable names a file that does not exist.
    """
    named = os.environ.get(VARIABLE)
    path = Path(named) if named else DEFAULT
    if not named and not path.exists():
        return Site()
    try:
        content = read_toml(path)
        _known(content, _TABLES, "")
        own = _table(_table(content, "rigs"), rig) if rig else {}
        _known(own, ("limits", "permits"), f"rigs.{rig}.")
        limits = _limits(_table(content, "limits"), "limits")
        for name, value in _limits(_table(own, "limits"), f"rigs.{rig}.limits").items():
            limits[name] = _NARROWER[name][0](limits.get(name, value), value)
        permits = {**_table(content, "permits"), **_table(own, "permits")}
        inputs = {name: _input(one, name) for name, one in permits.items() if "input" in _asked(one, name)}
    except (ParameterSetError, QuantityError) as error:
        said = str(error)
        raise RigError(said if str(path) in said else f"{path}: {said}") from None
    return Site(limits, inputs, tuple(name for name in permits if name not in inputs), path)


def _table(content: Mapping[str, Any], name: str) -> dict[str, Any]:
    found = content.get(name, {})
    if not isinstance(found, dict):
        raise QuantityError(f"[{name}] must be a table")
    return found


def _known(content: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for name in content:
        if name not in known:
            hint = did_you_mean(name, known)
            raise QuantityError(f"[{where}{name}] is unknown{hint}; there are {', '.join(known)}")


def _limits(content: Mapping[str, Any], where: str) -> dict[str, float]:
    _known(content, tuple(_NARROWER), f"{where}.")
    found = {name: to_si(value, _NARROWER[name][1], f"{where}.{name}") for name, value in content.items()}
    Limits(**{"stop_slew": min(1000.0, found.get("max_slew", math.inf)), **found})  # raises QuantityError
    return found


def _asked(content: Any, name: str) -> dict[str, Any]:
    if not isinstance(content, dict):
        raise QuantityError(f"[permits.{name}] must be a table")
    _known(content, _OF_PERMIT, f"permits.{name}.")
    return content


def _input(content: dict[str, Any], name: str) -> InputPermit:
    if not {"minimum", "maximum"} & content.keys():
        raise QuantityError(f"[permits.{name}] input needs a minimum, a maximum, or both")
    return InputPermit(str(content["input"]), content.get("minimum"), content.get("maximum"))
