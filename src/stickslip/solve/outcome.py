"""Outcomes of a run."""

from __future__ import annotations

DONE, STEP_TOO_SMALL, TOO_MANY_STEPS = 0, 1, 2
# Not an end: the log of steps must be read and emptied before the run goes on.
LOG_FULL = 3
