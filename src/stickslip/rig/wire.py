"""Protocol between the rig's process and its clients: JSON and numbers over a local socket.

A message is the length of its head (4 bytes, little-endian), the head and an array of float64, little-endian.
The head is a JSON object and gives the shape of the array as "shape". The head of a request names the request
as "do". Every request has one answer, except that a wrong token only ends the connection. In the answer of a
refused request, "error" is the message of the error and "kind" the name of its class.

The requests::

    | request | with | answer |
    |---|---|---|
    | hello | token, name, pid | number of the process |
    | open | device, see `description`; again: opened before | capabilities, told; or who holds the rig |
    | close | | the rig is at 0 V and free |
    | run | the fields of `order.Order`; the drive [V], or targets [m] for a closed loop | started |
    | command | what: arguments for the controller of the closed loop | accepted, or refused |
    | fetch | wait [s] | phase, position, began [m, rad], ramp_after [s], loop; next samples [inputs, n] |
    | home_here | input, calibration, slew [V/s] | the present position is home |
    | beat | | noted: the operator's page is alive |
    | stop | why; disarm: also disarm | stopped: True if a run was active |
    | state | | phase, position, holder, stopped, interlock |
    | arm, disarm, acknowledge | who, why | interlock: its state |
    | permit | name, given, who, why | interlock: its state |

Any client may send "hello", "open" and the requests from "beat" on; the others are accepted only from the
client that holds the rig (since "open"). If that client does not fetch for `Limits.watchdog`, or disconnects,
its run is stopped.
"""

from __future__ import annotations

import json
import socket
import struct
from typing import Any

import numpy as np

from ..gate.text import load_json
from .protocols import Array

LARGEST_HEAD = 1_000_000  # largest length of a head that is received, bytes
LARGEST_ARRAY = 60_000_000  # largest number of values of an array that is received (480 MB)


class WireError(OSError):
    """Received data are not a message of the protocol, or the message is too large."""


def send(link: socket.socket, head: dict[str, Any], values: Array | None = None) -> None:
    """Send a message over the socket `link`: `head` as JSON, and the numbers `values`, by default none.

    Raises:
        TypeError, ValueError: the head cannot be written as JSON. Nothing was sent.
        OSError: the connection is closed.
    """
    array = np.zeros(0) if values is None else np.ascontiguousarray(values, dtype="<f8")
    text = text_of({**head, "shape": array.shape}).encode()
    link.sendall(struct.pack("<I", len(text)) + text + array.tobytes())


def text_of(head: dict[str, Any]) -> str:
    """Return the head of a message as JSON text; numbers of NumPy become numbers of Python.

    Raises:
        TypeError: the head contains a type that JSON does not have.
        ValueError: the head contains itself.
    """
    return json.dumps(head, default=_plain)


def _plain(value: object) -> object:
    """Return a number of NumPy as a number of Python; TypeError for any other value."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r:.60} is no text, number or list")


def receive(link: socket.socket) -> tuple[dict[str, Any], Array]:
    """Wait for the next message on the socket `link`; return its head and its array.

    The array is empty if the sender gave none.

    Raises:
        EOFError: the other side has closed the connection.
        WireError: the received data are not a message, or it is too large.
        OSError: the connection has failed, or its timeout is over.
    """
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
