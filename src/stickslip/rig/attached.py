"""Registered back ends (clients of devices), and search for devices on this machine and on the network."""

from __future__ import annotations

import glob
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from ..quantities import registry
from .protocols import About, RigError

_PATIENCE = 3.0  # longest wait for a driver library to list its devices, s
_FILES = (
    ("/dev/ttyUSB*", "a serial port"),
    ("/dev/ttyACM*", "a serial port"),
    ("/dev/tty.usb*", "a serial port"),
    ("/dev/usbtmc*", "an instrument on USB"),
)
_OWN = About("of a user's own", "", "", "", "by its author, or not")


class Known(NamedTuple):
    """A registered back end: its name, its kind ("rig" or "positioner"), and its description."""

    name: str
    kind: str
    about: About


class Found(NamedTuple):
    """A device that was found.

    `where` is its serial port, "HOST:PORT" or its name in the maker's driver. `says` is its model or the
    identity that it reports; for a port only the type of the port. `name` is the name of the back end that
    can open it, or "" if that is unknown.
    """

    where: str
    says: str
    name: str = ""


def known_devices() -> list[Known]:
    """Return all registered back ends: rigs, then positioners, including those of installed packages."""
    return [Known(name, kind, _about(client)) for name, kind, client in _clients()]


def attached_devices() -> list[Found]:
    """Return the serial ports and USB instruments of this machine (Linux, macOS), and the DAQ cards (National
    Instruments).

    Nothing is sent to any port. Only the devices that a back end's static method `attached` lists, as DAQ
    cards, have a `name`.
    """
    found = [Found(port, words) for pattern, words in _FILES for port in sorted(glob.glob(pattern))]
    for name, _, client in _clients():
        if hasattr(client, "attached"):
            found += [Found(where, model, name) for where, model in _asked(client.attached)]
    return found


def probe(host: str, port: int | None = None, timeout: float = 0.5) -> list[Found]:
    """Return the known controllers that answer at a network address; empty if none does.

    Each back end with known ports asks for the identity of its own device. Only a controller that identifies
    itself gets more requests. A port on which nobody answers is no error.

    Args:
        host: name or address.
        port: TCP port that all back ends try; the search then ends at the first controller found. By default
            each back end tries the ports of its maker.
        timeout: longest wait for each answer, s.
    """
    found = []
    asked = [(name, client) for name, _, client in _clients() if _about(client).ports is not None]
    for name, client in sorted(asked, key=lambda one: getattr(one[1], "asked_last", False)):
        for at in (_about(client).ports or ()) if port is None else (port,):
            with suppress(RigError):
                found.append(Found(f"{host}:{at}", _identity(client, host, at, timeout), name))
                if port is not None:
                    return found
    return found


def _clients() -> Iterator[tuple[str, str, Any]]:
    """Yield the name, the kind ("rig" or "positioner") and the class of each registered back end."""
    for kind in (registry.rigs, registry.positioners):
        yield from ((name, kind.noun, client) for name, client in kind.all())


def _about(client: Any) -> About:
    return getattr(client, "about", _OWN)


def _identity(client: Any, host: str, port: int, timeout: float) -> str:
    """Return the identity that the device at an address reports, as a text.

    If the class `client` has no method `identify`, the device is opened and closed; the identity is then the
    `name` in its `capabilities` or `ranges`.

    Raises:
        RigError: the device is not of the kind that `client` controls, or nobody answers within `timeout` s.
    """
    if hasattr(client, "identify"):
        return client.identify(host, port, timeout)
    opened = client(host, port=port, timeout=timeout)
    opened.close()
    return (opened.capabilities if hasattr(opened, "capabilities") else opened.ranges).name


def _asked(what: Callable[[], list[Any]]) -> list[Any]:
    """Call the function `what`, which lists devices, and return its list.

    The list is empty if the function raises an error or does not return within `_PATIENCE`. The call is made
    in a thread of its own, because a driver library may hang.
    """
    made: list[Any] = []

    def ask() -> None:
        try:
            made.extend(what())
        except Exception:  # the types of the errors of a missing library or driver are not known
            return

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(_PATIENCE)
    return list(made)
