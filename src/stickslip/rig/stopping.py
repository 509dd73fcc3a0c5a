"""A stop of a rig, followed from the request to the evidence that the output is at 0 V. States:

    asked       a stop is requested
    preparing   the process was preparing a run, which will not start: the output is at 0 V
    delivered   the rig's process has answered the request
    ramping     the rig ramps to 0 V
    ramped      the rig reports that its ramp has ended
    measured    the amplifier's monitor, if there is one, reads 0 V

The states "asked", "delivered" and "ramping" have a deadline. If it passes, the state of the output is
unknown: people are told to switch the amplifier off, and the stop is still tried.
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

ANSWERS = 1.0  # s in which the rig's process must answer and start its ramp
RAMPED = LONGEST_STOP + 2.0  # s, longest ramp, with a margin
_AGAIN = 0.05  # s between two requests for a stop


class StopState(NamedTuple):
    """Progress of a stop.

    `state` is one of the module's states, and `after` the time since the request, s. `measured` is the
    reading of the amplifier's monitor, V; None if there is none yet. `alarm` is what people must do now, such
    as to switch the amplifier off, or "".
    """

    state: str = "asked"
    after: float = 0.0
    measured: float | None = None
    alarm: str = ""


def follow_stop(
    folder: Path, why: str, tell: Callable[[StopState], None], needed: Callable[[], bool], asked: float
) -> StopState:
    """Stop a rig, and follow the stop until its process reports 0 V; return the last state.

    The request is repeated until then. The function also returns if neither process nor run exists any more.

    Args:
        folder: folder of the process that owns the rig.
        why: reason, sent to the process.
        tell: called with each new state.
        needed: returns True while a run of this program is active. If none is and no process answers, there
            is nothing to stop.
        asked: time of the request, s of `time.perf_counter`.
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
            return found  # process and run are gone: only people can look
        time.sleep(_AGAIN)


def _tried(folder: Path, why: str) -> tuple[str | None, float | None, str]:
    """Ask the process of a rig for a stop, once.

    Returns:
        The state (None without an answer), the monitor reading [V] (None without one), and the failure of the
        stop in words ("" if it has not failed).
    """
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
    # The process prepares a run that will not start: nothing is put out.
    return ("preparing" if said.get("phase") == "preparing" else "delivered"), None, ""
