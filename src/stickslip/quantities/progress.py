"""Progress of long calls: every `progress` argument is called as ``progress(doing, done)``, with the present
activity in words and the finished fraction of the whole task, 0 to 1."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]


def unheard(doing: str, done: float) -> None:
    """Do nothing with the activity and the finished fraction of a call: the default of `progress`
    arguments."""


def within(progress: Progress, begin: float, length: float, doing: str, done: float) -> None:
    """Report the progress of one part of a task as progress of the whole task.

    Args:
        progress: function that is called with activity and finished fraction of the whole task.
        begin: fraction of the whole at which the part starts.
        length: length of the part, as a fraction of the whole.
        doing: current activity.
        done: finished fraction of the part, 0 to 1.
    """
    progress(doing, begin + length * done)
