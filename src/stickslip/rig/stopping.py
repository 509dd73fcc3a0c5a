"""A stop, from the request until there is evidence that the output is at 0 V.

    asked       somebody wants it
    delivered   the rig's process has answered the request
    ramping     the rig was told to go to 0 V
    ramped      the rig says that its ramp has ended
    measured    the amplifier's monitor reads 0 V, of a rig that has one

Each state has a deadline. Where one passes, nobody knows what the output does: people are told to switch the
amplifier off, and the stop is still tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from .hosted import UNANSWERED, greeted
from .limits import LONGEST_STOP
from .protocols import RigError
from .wire import receive, send

ANSWERS = 1.0  # s in which the rig's process must answer, and begin its ramp
RAMPED = LONGEST_STOP + 2.0  # s from the begin of the ramp to the end of it
_AGAIN = 0.05  # s between two looks


class StopState(NamedTuple):
    """How far a stop has come: the state (see the module) since the request [s], what the monitor reads [V],
    and what people must do now, or ""."""

    state: str = "asked"
    after: float = 0.0
    measured: float | None = None
    alarm: str = ""


def follow_stop(
    folder: Path, why: str, tell: Callable[[StopState], None], needed: Callable[[], bool], asked: float
) -> StopState:
    """Stop the rig whose process owns a folder, and follow it to its evidence.

    Args:
        folder: of the process.
        why: what is told to it.
        tell: called with each state that is new.
        needed: whether anything of this program still goes on; where nothing does, and no process is there,
            there is nothing to stop.
        asked: when it was asked for, `time.perf_counter`.
    """
    found, since = StopState(), asked
    while True:
        now = time.perf_counter()
        state, measured, failed = _tried(folder, why)
        if state is None:
            if not needed() and found.state == "asked" and not found.alarm:
                return found
            late = now - since > ANSWERS
            new = found._replace(alarm=UNANSWERED if late else found.alarm)
        else:
            if state != found.state:
                since = now
            late = now - since > (RAMPED if state == "ramping" else ANSWERS)
            alarm = failed or (UNANSWERED if late and state in ("delivered", "ramping") else "")
            new = StopState(state, now - asked, measured, alarm)
        if new._replace(after=0.0) != found._replace(after=0.0):
            tell(new)
        found = new
        if found.state in ("ramped", "measured"):
            return found
        if state is None and found.alarm and not needed():
            return found  # the process is gone, and the run with it: only people can look
        time.sleep(_AGAIN)


def _tried(folder: Path, why: str) -> tuple[str | None, float | None, str]:
    """What the process says: state, monitor [V], and what failed; no state where it does not answer."""
    try:
        link = greeted(folder, "a stop", ANSWERS)
        if link is None:
            return None, None, ""
        with link:
            link.settimeout(ANSWERS)
            send(link, {"do": "stop", "why": why})
            receive(link)
            send(link, {"do": "state"})
            said = receive(link)[0]
    except (OSError, EOFError, RigError):
        return None, None, ""
    stopped = said.get("stopped", {})
    if said.get("phase") == "idle":
        measured = stopped.get("measured")
        return ("ramped" if measured is None else "measured"), measured, str(stopped.get("failed", ""))
    if said.get("phase") == "stopping":
        return "ramping", None, ""
    # It prepares a run that will not begin: nothing is put out.
    return ("preparing" if said.get("phase") == "preparing" else "delivered"), None, ""
