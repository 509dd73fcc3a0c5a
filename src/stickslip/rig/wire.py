"""Protocol between the rig's process and its clients: JSON and numbers over a socket of this machine.

A message is the length of its head (4 bytes, lowest first), the head, JSON with the shape of what follows as
"shape", and that many float64. Every request has one answer; an answer with "error" says what is wrong, and
"kind" of which class it is.

| request | with | answer |
|---|---|---|
| hello | token, name, pid | who is there |
| open | device, see `devices`; again: in the same recording | capabilities; or who holds the rig |
| close | | the rig is free |
| run | limits, inputs, samples, rest, position, keep (see `samples`); the drive [V] | begins |
| | and controller (see `protocols.ControllerSpec`), for a closed loop; targets [m] | begins |
| command | what, to the controller of that loop | it has taken it, or refused it |
| fetch | wait [s] | phase, position, began [m], ramp_after [s], loop; the next samples [inputs, n] |
| stop | why | whether a run was going on; from any client |
| home_here | input, calibration, slew | calls the present position home |
| state | | phase, position, holder |

A client that runs something and does not fetch for `Limits.watchdog`, or goes, has its run stopped.
"""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

import numpy as np

from ..gate.text import load_json
from .protocols import Array

LARGEST_HEAD = 1_000_000  # bytes
LARGEST_ARRAY = 60_000_000  # numbers


class WireError(OSError):
    """What came is no message."""


def send(link: socket.socket, head: dict[str, Any], values: Array | None = None) -> None:
    """Send a message; errors of `text_of` come before anything is sent."""
    array = np.zeros(0) if values is None else np.ascontiguousarray(values, dtype="<f8")
    text = text_of({**head, "shape": array.shape}).encode()
    link.sendall(struct.pack("<I", len(text)) + text + array.tobytes())


def text_of(head: dict[str, Any]) -> str:
    """As JSON, numbers of NumPy as Python's; TypeError for what it does not know, ValueError for circles."""
    return json.dumps(head, default=_plain)


def _plain(value: object) -> object:
    """A number of NumPy as Python's; TypeError for all else that JSON does not know."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r:.60} is no text, number or list")


def receive(link: socket.socket) -> tuple[dict[str, Any], Array]:
    """The next message; EOFError where the other side has gone, WireError for what is none."""
    (length,) = struct.unpack("<I", _exactly(link, 4))
    if length > LARGEST_HEAD:
        raise WireError(f"a head of {length} bytes")
    try:
        head = load_json(_exactly(link, length), "message")
        shape = tuple(int(n) for n in head.pop("shape"))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise WireError(f"no message: {error}") from None
    count = int(np.prod(shape)) if all(0 <= n <= LARGEST_ARRAY for n in shape) and len(shape) < 3 else -1
    if not 0 <= count <= LARGEST_ARRAY:
        raise WireError(f"an array of the shape {shape}")
    return head, np.frombuffer(_exactly(link, 8 * count), dtype="<f8").reshape(shape)


def _exactly(link: socket.socket, count: int) -> bytes:
    parts, left = [], count
    while left:
        part = link.recv(min(left, 1 << 20))
        if not part:
            raise EOFError("the other side has gone")
        parts.append(part)
        left -= len(part)
    return b"".join(parts)
