"""Stop of a rig in another process, followed from the request to the evidence that the output is at 0 V.

The states of a stop are:

- asked: a stop is requested.
- preparing: the process was preparing a run, which will not start: the output is at 0 V.
- delivered: the rig's process has answered the request.
- ramping: the rig ramps to 0 V.
- ramped: the rig's ramp has ended (the amplifier has no monitor), or has failed (with an alarm).
- measured: the ramp has ended, and the amplifier's monitor reads 0 V.

The states "asked" and "delivered" may last `ANSWERS` s, "ramping" `RAMPED` s. After that the state of the
output is unknown: an alarm asks people to switch the amplifier off, and the stop is still tried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from .hosted import UNANSWERED
from .limits import LONGEST_STOP
from .protocols import RigError
from .reaching import greeted
from .wire import receive, send

ANSWERS = 1.0  # time, s, in which the rig's process must answer a request and start its ramp
RAMPED = LONGEST_STOP + 2.0  # time, s, in which the ramp to 0 V must end: the longest ramp plus a margin
_AGAIN = 0.05  # pause between two requests for the same stop, s


class StopState(NamedTuple):
    """Progress of a stop.

    `state` is one of the module's states, and `after` the time since the request, s. `measured` is the
    reading of the amplifier's monitor, V; None without a monitor or before the reading. `alarm` asks people
    in words to act now, such as to switch the amplifier off; "" if nothing is wrong.
    """

    state: str = "asked"
    after: float = 0.0
    measured: float | None = None
    alarm: str = ""


def follow_stop(
    folder: Path, why: str, tell: Callable[[StopState], None], needed: Callable[[], bool], asked: float
) -> StopState:
    """Stop a rig, wait until its process reports 0 V or (in `alarm`) a failure, and return the last state.

    The request is repeated every `_AGAIN` s until then. Without an answer of the process and without an
    active run, the function returns too: at once with the state "asked" if the process never answered and
    no deadline has passed, else with an `alarm`. No error is raised.

    Args:
        folder: folder of the process that owns the rig.
        why: reason, sent to the process.
        tell: called with each new `StopState`; a change of `after` alone is not reported.
        needed: called without arguments; returns True while a run of this program is active.
        asked: time of the first request, s of `time.perf_counter`.
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
            return found  # the process does not answer and no run is active: only people can look
        time.sleep(_AGAIN)


def _tried(folder: Path, why: str) -> tuple[str | None, float | None, str]:
    """Send one request for a stop to the process of a rig, then ask the process for its state.

    Returns:
        The state of the stop, one of the module's states (None without an answer); the reading of the
        amplifier's monitor [V] (None without one); and the failure of the stop in words ("" if it has not
        failed).
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
