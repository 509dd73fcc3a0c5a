"""Sharing of slow answers: computed once for all pages that ask at the same time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any

_KEPT = 8  # largest number of answers that are kept, of different questions


class Shared:
    """Cache of answers that computes one answer at a time.

    A caller that has to wait gets another caller's answer to the same question, if its computation started
    after the call; the answer is then not outdated. Without this, many pages that ask at the same time would
    block all other requests.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._begun = 0  # number of computations started so far
        # Number of the computation and its answer, by question. The answer used last is the last entry.
        self._answers: dict[Hashable, tuple[int, Any]] = {}

    def __call__(self, question: Hashable, make: Callable[[], Any]) -> Any:
        """Return the answer to a question, computed by `make` or by another caller during this call.

        Callers must not modify it. `question` is any key that identifies the question; `make` takes nothing.
        """
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
