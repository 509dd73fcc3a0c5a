"""Progress of long calls: every `progress` argument is called as ``progress(doing, done)``, with what is
being done in words and how much of all is done, from 0 to 1."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str, float], None]


def unheard(doing: str, done: float) -> None:
    """Ignore the progress of a call."""


def within(progress: Progress, begin: float, length: float, doing: str, done: float) -> None:
    """Report the progress of one part of a task.

    Args:
        progress: function that receives the progress of the whole task.
        begin: fraction of the whole at which the part starts.
        length: length of the part, as a fraction of the whole.
        doing: current activity.
        done: finished fraction of the part, 0 to 1.
    """
    progress(doing, begin + length * done)
