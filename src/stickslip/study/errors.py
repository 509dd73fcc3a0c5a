"""Errors that end a whole study, and not only the computation of a member."""

from __future__ import annotations

STOPPED = "stopped, as was asked: what is finished is kept, and the same command goes on"


class StudyError(Exception):
    """Error: a study cannot start or continue, or its store cannot be read.

    Reasons are a full disk, workers that cannot compute, tasks that fail three times, a requested stop, and a
    missing or damaged store. Finished tasks are kept; the same call resumes the study.
    """


class StudyDiffers(ValueError):
    """Error: a store belongs to another study or has tasks of another size, or two stores differ so; the
    message has the differences.
    """
