"""Origin of the request that the server is answering: its page, network address and role.

A context variable holds the origin, so that log lines and checks of roles need no argument for it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple


class Asker(NamedTuple):
    """Sender of a request.

    `page` is the public name of the browser page (see `shown`), "" without one. `address` is the client's
    network address, "" outside of requests. `role` is the role of the client's token: "watch", "operate" or
    "maintain" (see `roles`).
    """

    page: str = ""
    address: str = ""
    role: str = "maintain"

    def named(self, operator: str) -> str:
        """Return the name for the log: the operator, followed in parentheses by the page, if any, and the
        role.

        `operator` is the operator's name in the experiment file, "" if the file names nobody; the result then
        says "somebody". The page is named by the first 6 digits of `page`. Outside of requests the result is
        the operator's name alone, or "the panel".
        """
        if not self.address:
            return operator or "the panel"
        who = f"page {self.page[:6]}, may {self.role}" if self.page else f"may {self.role}"
        return f"{operator or 'somebody'} ({who})"


_NOW: ContextVar[Asker] = ContextVar("asker", default=Asker())  # noqa: B039  # a named tuple is immutable


@contextmanager
def asked_by(asker: Asker) -> Iterator[None]:
    """Let `asking` return this asker within the `with` block, in which a request is answered."""
    before = _NOW.set(asker)
    try:
        yield
    finally:
        _NOW.reset(before)


def asking() -> Asker:
    """Return the sender of the current request.

    Outside of requests page and address are "", and the role is "maintain".
    """
    return _NOW.get()


def shown(identity: str) -> str:
    """Return the public name of a page: 16 hexadecimal digits of the hash of its secret `identity`.

    An empty secret gives "".
    """
    return hashlib.sha256(identity.encode()).hexdigest()[:16] if identity else ""
