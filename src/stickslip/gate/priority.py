"""Priority of processes: high for a process that controls an output, low for one with long computations.

Linux may divide processor time among sessions first, and then among the processes of each session
("autogroup"). A computing process therefore gets a session of its own; in the session of the control panel it
would use up the panel's share. Raising a priority needs a permission (`RLIMIT_NICE`); without it the priority
stays as it is.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

# Nice value (0 is the normal, 19 the lowest priority) of processes with long computations: fits, studies, and
# the process that parses files.
LAST = 10


def come_first(nice: int) -> None:
    """Raise the priority of this process to a negative nice value, if that is permitted.

    The priority of its session is raised too, if this process leads the session or has a terminal. Call this
    before threads are started, because the priority applies to the calling thread and those it starts.
    """
    if hasattr(os, "setpriority"):
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, nice)
            if os.getsid(0) == os.getpid() or os.isatty(0):
                Path("/proc/self/autogroup").write_text(str(nice))


def come_last() -> None:
    """Lower the priority of this process to `LAST`, and give it a session of its own.

    Ctrl-C and the end of a terminal then no longer end it, so the program that started it must do so.
    """
    if hasattr(os, "setpriority"):
        # OSError is raised if the process already leads a process group.
        with suppress(OSError):
            os.setsid()
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), LAST))
