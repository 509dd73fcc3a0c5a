"""Interlock of a rig: a state machine that decides whether a run may start.

    fault      a fault ended a run and has not been acknowledged
    withheld   a permit is missing
    disarmed   the output is not enabled
    armed      a run may start

Arming is refused during a fault or without a permit. A fault or a withdrawn permit disarms. Fault and permits
are kept in a file, so a restart clears neither; after a restart the output is disarmed. A damaged file counts
as a fault. A simulated rig has no physical output and needs no arming. In a process of its own its faults and
permits work in the same way; in this program a simulated rig has no interlock. The interlock never delays a
stop, and a run at 0 V needs no permission.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from ..quantities.records import did_you_mean
from ..quantities.units import QuantityError
from ..recording.replacing import read_small, replaced_whole
from .capture import CaptureError
from .protocols import RigError, StopRequested

OPERATORS = "operators"  # name of the permit that every rig needs; it is given from the beginning
FILE = "interlock.json"
_LONGEST = 400  # greatest number of characters of a reason; the rest is cut off
HOW_TO_ARM = "Arm it on purpose: --arm WHY on the command line, stickslip.rig.armed(WHY), or the panel"
_HOW_TO_ACKNOWLEDGE = (
    "Look at the rig, then acknowledge the fault: stickslip interlock FILE --acknowledge WHY, "
    "stickslip.rig.interlock_of(rig).acknowledge(WHO, WHY), or the panel"
)

# Function that is called with each act on an interlock. Its arguments are the act ("armed", "disarmed",
# "refused", "fault", "acknowledged", "permit given", "permit withdrawn"), who acted, the object, and why.
Log = Callable[[str, str, str, str], None]


class InterlockError(RigError):
    """A run may not start. The message says what is missing and what to do."""


class Permit(NamedTuple):
    """State of a permit: given or withdrawn, by whom, when (local time, ISO 8601) and why."""

    given: bool = False
    who: str = "nobody"
    when: str = ""
    why: str = "it was never given"


def _unlogged(act: str, who: str, what: str, why: str) -> None:
    """Do nothing: the default of the argument `log` of `Interlock`, which is called with each act."""


class Interlock:
    """State machine of one rig, which decides whether a run may start; the module lists the states.

    Args:
        path: JSON file that keeps fault and permits; by default they are kept in memory.
        required: names of the permits that the rig needs in addition to the operators' permit.
        log: called with each act, see `Log`; by default acts are not logged.
        simulated: True for a simulated rig.
    """

    def __init__(
        self,
        path: Path | None = None,
        required: Iterable[str] = (),
        log: Log = _unlogged,
        simulated: bool = False,
    ) -> None:
        self.simulated = simulated
        self._path, self._log = path, log
        self._lock = threading.RLock()
        self._armed = self._fault = self._since = ""
        # All permits that were ever given or withdrawn, by name, whether or not the rig needs them now.
        self._kept = {OPERATORS: Permit(True, "", "", "")}
        self._required = (OPERATORS, *required)
        self._load()

    def require(self, names: Iterable[str]) -> None:
        """Require these permits, and the operators' permit, from now on instead of the previous ones.

        A permit that nobody has given yet counts as missing.
        """
        with self._lock:
            self._required = (OPERATORS, *names)

    @property
    def _permits(self) -> dict[str, Permit]:
        return {name: self._kept.get(name, Permit()) for name in self._required}

    def need(self) -> None:
        """Raise InterlockError unless a run may start: no fault, all permits given, output armed.

        A simulated rig need not be armed. A refusal is logged.
        """
        with self._lock:
            missing = self._missing()
            if not missing and not self._armed and not self.simulated:
                missing = f"the output is not armed. {HOW_TO_ARM}"
        if missing:
            self._log("refused", "", "start", missing)
            raise InterlockError(missing)

    def arm(self, who: str, why: str) -> None:
        """Enable the output.

        Args:
            who: name of the person or program.
            why: the reason, which is logged.

        Raises:
            InterlockError: there is a fault, or a permit is missing.
            QuantityError: no reason is given.
        """
        why = _reason(why)
        with self._lock:
            missing = self._missing()
            if not missing:
                self._armed = who or "somebody"
        self._log("refused" if missing else "armed", who, "arm" if missing else "the output", missing or why)
        if missing:
            raise InterlockError(missing)

    def disarm(self, who: str, why: str) -> None:
        """Disable the output; if it was enabled, log `who` and `why`. The caller must stop an active run."""
        with self._lock:
            was, self._armed = self._armed, ""
        if was:
            self._log("disarmed", who, "the output", why)

    def latch(self, what: str) -> None:
        """Disarm, and keep a fault until `acknowledge`. Further faults until then are logged, but not kept.

        Args:
            what: the fault, in words.
        """
        with self._lock:
            self._armed = ""
            if not self._fault:
                self._fault, self._since = what, _now()
            self._save()
        self._log("fault", "", what, "")

    def acknowledge(self, who: str, why: str) -> None:
        """Clear the fault; `who` and the reason `why` are logged. The output stays disarmed.

        Raises:
            QuantityError: no reason is given, or there is no fault.
        """
        why = _reason(why)
        with self._lock:
            if not self._fault:
                raise QuantityError("there is no fault to acknowledge")
            fault, self._fault, self._since = self._fault, "", ""
            self._save()
        self._log("acknowledged", who, fault, why)

    def permit(self, name: str, given: bool, who: str, why: str) -> None:
        """Give or withdraw a permit; a withdrawal disarms.

        Args:
            name: name of the permit, such as "operators".
            given: True to give the permit, False to withdraw it.
            who: name of the person or program.
            why: the reason, which is logged.

        Raises:
            QuantityError: the rig has no such permit, or no reason is given.
        """
        why = _reason(why)
        with self._lock:
            if name not in self._permits:
                known = ", ".join(self._permits)
                raise QuantityError(
                    f"{name[:60]!r} is no permit of this rig{did_you_mean(name, self._permits)}; "
                    f"there are {known}"
                )
            self._kept[name] = Permit(given, who or "somebody", _now(), why)
            if not given:
                self._armed = ""
            self._save()
        self._log("permit given" if given else "permit withdrawn", who, name, why)

    @classmethod
    def of_state(cls, said: Mapping[str, Any]) -> Interlock:
        """Return a copy, in memory, of another interlock, from the data `said` that its `state` returned."""
        made = cls(simulated=said["simulated"])
        made._armed, made._fault, made._since = said["armed_by"], said["fault"], said["since"]
        made._required = tuple(said["permits"])
        made._kept = {name: Permit(**one) for name, one in said["permits"].items()}
        return made

    def state(self) -> dict[str, Any]:
        """Return the state with its causes, as JSON data.

        The keys are `state` ("fault", "withheld", "disarmed" or "armed"); `simulated`; `armed_by` (who, or
        ""); `fault` (in words, or ""); `since` (local time of the fault, or ""); and `permits` (fields of
        `Permit` by name of the permit).
        """
        with self._lock:
            if self._fault:
                now = "fault"
            elif not all(one.given for one in self._permits.values()):
                now = "withheld"
            else:
                now = "armed" if self._armed else "disarmed"
            return {
                "state": now,
                "simulated": self.simulated,
                "armed_by": self._armed,
                "fault": self._fault,
                "since": self._since,
                "permits": {name: one._asdict() for name, one in self._permits.items()},
            }

    def _missing(self) -> str:
        """Return the fault or the first missing permit in words, with advice; "" if arming is allowed."""
        if self._fault:
            return f"a fault of {self._since} is not acknowledged: {self._fault}. {_HOW_TO_ACKNOWLEDGE}"
        for name, one in self._permits.items():
            if not one.given:
                return (
                    f"the permit {name!r} is missing: {one.who}, {one.why}. Give it when it is safe: "
                    f"stickslip interlock FILE --give {name} --why WHY, or the panel"
                )
        return ""

    def _load(self) -> None:
        if self._path is None:
            return
        try:
            known = read_small(self._path) or {}
            self._fault, self._since = str(known.get("fault", "")), str(known.get("since", ""))
            for name, kept in dict(known.get("permits", {})).items():
                self._kept[str(name)] = Permit(kept["given"] is True, *(str(kept[one]) for one in _TEXTS))
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            self._fault, self._since = f"{self._path} is damaged ({error})", _now()

    def _save(self) -> None:
        if self._path is None:
            return
        kept = {"fault": self._fault, "since": self._since}
        permits = {name: one._asdict() for name, one in self._kept.items()}
        # An error of writing, such as a full disk, must not end the process: the state is still in memory.
        with suppress(OSError), replaced_whole(self._path) as temporary:
            temporary.write_text(json.dumps({**kept, "permits": permits}), encoding="utf-8")


_TEXTS = ("who", "when", "why")


def _now() -> str:
    return datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")


def _reason(why: str) -> str:
    """Return the text of a reason as one line of at most `_LONGEST` characters; QuantityError if empty."""
    said = " ".join(str(why).split())[:_LONGEST]
    if not said:
        raise QuantityError("a reason is needed: say why, in a few words")
    return said


def is_fault(failure: BaseException | None) -> bool:
    """Return True if the end of a run is a fault of the rig.

    `failure` is the error that ended the run, None for a complete run. Every error is a fault, except a
    requested stop (StopRequested) and a trigger that did not come (CaptureError).
    """
    return failure is not None and not isinstance(failure, StopRequested | CaptureError)


_ARMED: list[str] = []  # reasons of the active `armed` contexts, innermost last


@contextmanager
def armed(why: str) -> Iterator[None]:
    """Arm the runs that this program starts within the context, in any thread; allow positioners to move.

    Each run other than at 0 V is armed at its start and disarmed at its end. Contexts can be nested.

    Args:
        why: the reason, for the log.

    Raises:
        QuantityError: no reason is given.
    """
    _ARMED.append(_reason(why))
    try:
        yield
    finally:
        _ARMED.pop()


def arming() -> str:
    """Return the reason given to the innermost active context `armed`; "" outside of such contexts."""
    return _ARMED[-1] if _ARMED else ""


_INTERLOCKS: WeakKeyDictionary[Any, Interlock] = WeakKeyDictionary()


def interlock_of(rig: Any) -> Any:
    """Return the interlock of a rig, or None for a simulated rig in this program, which needs none.

    A `HostedRig` has the interlock of its process, as a `HostedInterlock`. Any other rig in this program has
    an `Interlock` of its own in memory, which is made at the first call.
    """
    hosted = getattr(rig, "interlock", None)
    if hosted is not None:
        return hosted
    if getattr(rig, "simulated", False):
        return None
    try:
        return _INTERLOCKS.setdefault(rig, Interlock())
    except TypeError:  # a user's own rig cannot be a dictionary key: its interlock cannot be kept
        return Interlock()


@contextmanager
def enabled(rig: Any, drive: bool) -> Iterator[Callable[[BaseException | None], None]]:
    """Check the interlock at the start of one run of a rig in this program.

    Within `armed` the output is armed for this run only. The context yields a function, which the caller
    must call at the end of the run with the error that ended the run, or None. A RigError that is a fault
    (`is_fault`) is then latched.

    Args:
        rig: a rig in this program; a rig that is supervised in its own process is not checked here.
        drive: True if anything but 0 V is put out; a run at 0 V needs no permission.

    Raises:
        InterlockError: the run may not start.
    """
    interlock = None if getattr(rig, "guard", None) is not None else interlock_of(rig)
    if interlock is None:
        yield lambda failure: None
        return
    own = arming() if drive else ""
    if own:
        interlock.arm("this program", own)
    if drive:
        interlock.need()

    def ended(failure: BaseException | None) -> None:
        if isinstance(failure, RigError) and is_fault(failure):
            interlock.latch(str(failure) or type(failure).__name__)

    try:
        yield ended
    finally:
        if own:
            interlock.disarm("this program", "the run has ended")


class HostedInterlock:
    """Client of the interlock of a rig in its own process.

    Its methods are those of `Interlock` for people: `arm`, `disarm`, `acknowledge`, `permit` and `state`.
    They raise the same errors, and RigError if the process is gone.

    Args:
        ask: `Link.ask` of a connection to that process.
    """

    def __init__(self, ask: Callable[..., Any]) -> None:
        self._ask = ask

    def arm(self, who: str, why: str) -> None:
        """Enable the output, for the reason `why`; the end of this connection disarms again."""
        self._ask("arm", who=who, why=why)

    def disarm(self, who: str, why: str) -> None:
        """Disable the output and stop an active run; `who` and the reason `why` are logged."""
        self._ask("disarm", who=who, why=why)

    def acknowledge(self, who: str, why: str) -> None:
        """Clear the fault; `who` and `why` are logged. Raises QuantityError without a reason or a fault."""
        self._ask("acknowledge", who=who, why=why)

    def permit(self, name: str, given: bool, who: str, why: str) -> None:
        """Give (`given` True) or withdraw the permit `name`; `who` and the reason `why` are logged.

        Withdrawing also disarms, and stops an active run. QuantityError without a reason or such a permit.
        """
        self._ask("permit", name=name, given=given, who=who, why=why)

    def state(self) -> Mapping[str, Any]:
        """Return the state with its causes, as `Interlock.state`."""
        return self._ask("state")[0]["interlock"]
