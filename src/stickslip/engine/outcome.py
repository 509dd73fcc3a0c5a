"""Outcomes of a run, as in `c/engine.h`."""

from __future__ import annotations

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS = 0, 1, 2
# Not an end: the log of steps must be read and emptied before the run goes on.
LOG_FULL = 3
# An orbit was not found in as many periods as allowed.
NOT_FOUND = 7
