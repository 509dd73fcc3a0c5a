"""Priority of a process: what owns an output comes first, what computes for long comes last.

Linux may share the processor among sessions first, and among the processes of a session afterwards
("autogroup"). A process that computes therefore gets a session of its own: in the session of the panel it
would use up the panel's share. To raise a priority needs a permission (`RLIMIT_NICE`); without it the
priority stays as it is.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

LAST = 10  # nice value of fits, studies and the process that reads files


def come_first(nice: int) -> None:
    """Raise the priority of this process to a nice value, where that is permitted, and that of its session if
    the session is its own or that of a terminal. Called before threads are started."""
    if hasattr(os, "setpriority"):
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, nice)
            if os.getsid(0) == os.getpid() or os.isatty(0):
                Path("/proc/self/autogroup").write_text(str(nice))


def come_last() -> None:
    """Lower the priority of this process, in a session of its own. Ctrl-C and the end of a terminal no longer
    reach it: whoever started it ends it."""
    if hasattr(os, "setpriority"):
        with suppress(OSError):  # the process leads a session already
            os.setsid()
        os.setpriority(os.PRIO_PROCESS, 0, max(os.getpriority(os.PRIO_PROCESS, 0), LAST))
