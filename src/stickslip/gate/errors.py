"""Errors of the gate, and conversion of other errors to one documented type with a one-sentence message."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

# Largest number of characters of another error's message that a message quotes.
_LONGEST = 300


class GateError(ValueError):
    """Error: a file is refused. The message names the file, and says why and what to do."""


class GateBusy(GateError):
    """Error: a file could not be read for a reason outside the file; trying again may succeed."""


@contextmanager
def damaged(kind: type[Exception], said: str) -> Iterator[None]:
    """Context that converts every exception raised in it to one documented type.

    Content that was damaged by hand or on a disk can raise almost any exception when it is interpreted.
    Errors of the given type, MemoryError and GateBusy pass unchanged.

    Args:
        kind: the documented type of error, which is raised.
        said: start of the message, usually the path of the file; the original error's message follows.
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
