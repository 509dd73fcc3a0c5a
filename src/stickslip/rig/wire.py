"""Protocol between the rig's process and its clients: JSON and numbers over a local socket.

A message is the length of its head (4 bytes, little-endian), the head and an array of float64. The head is
JSON and gives the shape of the array as "shape". Every request has one answer. An answer with "error" is an
error message, with the name of its class as "kind".

The requests::

    | request | with | answer |
    |---|---|---|
    | hello | token, name, pid | number of the process |
    | open | device, see `devices`; again: in the same recording | capabilities, or who holds the rig |
    | close | | the rig is free |
    | run | limits, inputs, samples, rest, position, keep (see `samples`); the drive [V] | started |
    | | and controller (see `protocols.ControllerSpec`), for a closed loop; targets [m] | started |
    | command | what, to the controller of that loop | accepted, or refused |
    | fetch | wait [s] | phase, position, began [m], ramp_after [s], loop; the next samples [inputs, n] |
    | beat | from any client | taken as a sign of life of the operator's page |
    | stop | why; from any client | whether a run was active |
    | home_here | input, calibration, slew | the present position is home |
    | state | | phase, position, holder |

The run of a client that does not fetch for `Limits.watchdog`, or disconnects, is stopped.
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
    """The received data are not a message."""


def send(link: socket.socket, head: dict[str, Any], values: Array | None = None) -> None:
    """Send a message. Errors of `text_of` are raised before anything is sent."""
    array = np.zeros(0) if values is None else np.ascontiguousarray(values, dtype="<f8")
    text = text_of({**head, "shape": array.shape}).encode()
    link.sendall(struct.pack("<I", len(text)) + text + array.tobytes())


def text_of(head: dict[str, Any]) -> str:
    """Return the JSON text, with NumPy numbers as Python's. TypeError for unknown types, ValueError for
    cycles."""
    return json.dumps(head, default=_plain)


def _plain(value: object) -> object:
    """Return a NumPy number as Python's. TypeError for other types that JSON does not support."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r:.60} is no text, number or list")


def receive(link: socket.socket) -> tuple[dict[str, Any], Array]:
    """Return the next message. EOFError if the other side has gone, WireError if it is not a message."""
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
