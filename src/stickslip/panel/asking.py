"""Origin of the request that is being answered: its page, address and role."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple


class Asker(NamedTuple):
    """Sender of a request: public name of its page, address, role of its token (see `roles`)."""

    page: str = ""
    address: str = ""
    role: str = "maintain"

    def named(self, operator: str) -> str:
        """Return the operator's name with the page and the role."""
        if not self.address:
            return operator or "the panel"
        who = f"page {self.page[:6]}, may {self.role}" if self.page else f"may {self.role}"
        return f"{operator or 'somebody'} ({who})"


_NOW: ContextVar[Asker] = ContextVar("asker", default=Asker())  # noqa: B039  # it cannot be changed


@contextmanager
def asked_by(asker: Asker) -> Iterator[None]:
    """Set the asker while a request is answered."""
    before = _NOW.set(asker)
    try:
        yield
    finally:
        _NOW.reset(before)


def asking() -> Asker:
    """Return the asker of the current request; an empty asker outside of requests."""
    return _NOW.get()


def shown(identity: str) -> str:
    """Return the public name of a page, a hash of its secret; "" without a secret."""
    return hashlib.sha256(identity.encode()).hexdigest()[:16] if identity else ""
