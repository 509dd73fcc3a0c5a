"""Origin of the request that is being answered: its page, address and role."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple


class Asker(NamedTuple):
    """Sender of a request.

    `page` is the public name of its page (see `shown`), `address` the client's network address ("" outside of
    requests), `role` the role of its token: "watch", "operate" or "maintain".
    """

    page: str = ""
    address: str = ""
    role: str = "maintain"

    def named(self, operator: str) -> str:
        """Return the operator's name with the page and the role, for the log.

        Outside of requests the name alone, or "the panel" if it is empty. `operator` is the name that the
        experiment gives, "" if it gives none.
        """
        if not self.address:
            return operator or "the panel"
        who = f"page {self.page[:6]}, may {self.role}" if self.page else f"may {self.role}"
        return f"{operator or 'somebody'} ({who})"


_NOW: ContextVar[Asker] = ContextVar("asker", default=Asker())  # noqa: B039  # a named tuple is immutable


@contextmanager
def asked_by(asker: Asker) -> Iterator[None]:
    """Set the asker that `asking` returns within the `with` block, in which a request is answered."""
    before = _NOW.set(asker)
    try:
        yield
    finally:
        _NOW.reset(before)


def asking() -> Asker:
    """Return the asker of the current request; an empty asker outside of requests."""
    return _NOW.get()


def shown(identity: str) -> str:
    """Return the public name of a page: 16 hexadecimal digits of the hash of its secret `identity`.

    An empty secret gives "".
    """
    return hashlib.sha256(identity.encode()).hexdigest()[:16] if identity else ""
