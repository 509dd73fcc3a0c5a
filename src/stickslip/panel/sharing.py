"""Slow answers to pages, computed once for all pages that ask at the same time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any

_KEPT = 8  # number of answers to different questions that are kept


class Shared:
    """Cache that computes one answer at a time. A caller that had to wait gets the answer of another caller
    if its computation started after the request.

    Many pages ask at the same time, and many threads that scan a folder would block all other requests.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._begun = 0  # number of computations started so far, for all questions
        # Number of the computation and its answer, by question; the answer used last is the last entry.
        self._answers: dict[Hashable, tuple[int, Any]] = {}

    def __call__(self, question: Hashable, make: Callable[[], Any]) -> Any:
        """Return the answer to a question (any key), computed by the function `make` or shared with other
        callers, who must not modify it."""
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
