"""Errors that end a whole study, and not only the computation of a member."""

from __future__ import annotations

STOPPED = "stopped, as was asked: what is finished is kept, and the same command goes on"


class StudyError(Exception):
    """Error: a study cannot continue, because the disk is full, workers die, or tasks fail on all workers.

    Finished tasks are kept; the same call resumes the study.
    """


class StudyDiffers(ValueError):
    """Error: a store belongs to another study, or two stores to different ones; the message has the
    differences.
    """
