"""Errors of a study as a whole."""

from __future__ import annotations

STOPPED = "stopped, as was asked: what is finished is kept, and the same command goes on"


class StudyError(Exception):
    """A study that cannot continue: a full disk, workers that die, tasks that fail everywhere.

    Finished tasks are kept, and the same call resumes.
    """


class StudyDiffers(ValueError):
    """The store is of another study; says what differs."""
