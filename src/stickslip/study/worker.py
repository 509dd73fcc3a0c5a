"""Worker process of this machine: it reads a study, then numbers of tasks, from its standard input.

Each answer is a line of JSON on standard output: first `ready` with the process number, then for each task
`done` with the task's report, or `error` with a text (and `final`, true if no other task can succeed either).
The process ends when its input ends, so that no worker remains after the study's process was killed.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import sys
from typing import Any

from .errors import StudyError
from .measures import told
from .task import Load, received, run_task


def main() -> None:
    """Read a pickled `Load` from standard input, report ready, then compute each task whose number arrives.

    If the study cannot be computed here, report a final error instead and end. The process ignores SIGINT,
    its search path for modules becomes `Load.folders`, and printed output goes to standard error.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent process, which ends this one
    if hasattr(signal, "pthread_sigmask"):  # Windows has no such function
        # The parent has started this process with SIGINT blocked (`sigint_blocked`); now SIGINT is ignored.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # Printed output of a user's function goes to standard error, so that it does not mix with the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    load: Load = pickle.load(sys.stdin.buffer)
    sys.path[:] = list(load.folders) or sys.path

    def say(**what: Any) -> None:
        answers.write(json.dumps(what) + "\n")
        answers.flush()

    try:
        study, store = received(load)
    except Exception as error:
        say(error=str(error) if isinstance(error, StudyError | ValueError) else told(error), final=True)
        return
    say(ready=os.getpid())
    for line in sys.stdin.buffer:
        try:
            say(done=run_task(study, store, int(line)))
        except Exception as error:
            full = isinstance(error, StudyError)
            say(error=str(error) if full else told(error), final=full)


if __name__ == "__main__":
    main()
