"""Errors of the gate, and how others' errors become one documented sentence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_LONGEST = 300  # characters of a message that is quoted


class GateError(ValueError):
    """A file that is not let in; the message names the file and says why, and what to do."""


class GateBusy(GateError):
    """A file that could not be read for a reason outside the file; trying again may succeed."""


@contextmanager
def damaged(kind: type[Exception], said: str) -> Iterator[None]:
    """Raise one documented error for whatever damaged content leads to while it is interpreted.

    Content that was changed by hand or on a disk fails in as many ways as Python knows: this is the one place
    that catches them all. Errors of the given kind pass as they are, and so do a lack of memory and a
    file that was not read.

    Args:
        kind: the documented error.
        said: the file, and what it does not hold: the start of the message.
    """
    try:
        yield
    except (kind, GateBusy, MemoryError):
        raise
    except KeyError as error:
        raise kind(f"{said}: there is no {str(error)[:_LONGEST]} in it") from error
    except Exception as error:
        name = "" if isinstance(error, ValueError | OSError) else f"{type(error).__name__}: "
        text = " ".join(str(getattr(error, "strerror", None) or error).split())[:_LONGEST]
        file, _, rest = text.partition(": ")
        raise kind(f"{said}: {name}{rest if rest and said.startswith(file) else text}") from error
