"""Answers that take a while, of which each is made for all who ask at once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any

_KEPT = 8  # answers, to different questions


class Shared:
    """Makes one answer at a time: who waited for that takes what was begun after they asked.

    Many pages ask at once, and threads that all look at a folder let nobody else come to speak.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._begun = 0  # answers, so far
        self._answers: dict[
            Hashable, tuple[int, Any]
        ] = {}  # by the question: the how manieth, and what it is

    def __call__(self, question: Hashable, make: Callable[[], Any]) -> Any:
        """The answer to a question, not to be changed; `make` makes it."""
        before = self._begun
        with self.lock:
            number, answer = self._answers.pop(question, (0, None))
            if number <= before:
                number = self._begun = self._begun + 1
                answer = make()
            self._answers[question] = number, answer
            while len(self._answers) > _KEPT:
                del self._answers[next(iter(self._answers))]
            return answer
