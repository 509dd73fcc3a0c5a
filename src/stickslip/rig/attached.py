"""Known back ends, and devices that are connected to this machine or answer on the network."""

from __future__ import annotations

import glob
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from ..quantities import registry
from .protocols import About, RigError

_PATIENCE = 3.0  # s, longest wait for an answer of a library
_FILES = (
    ("/dev/ttyUSB*", "a serial port"),
    ("/dev/ttyACM*", "a serial port"),
    ("/dev/tty.usb*", "a serial port"),
    ("/dev/usbtmc*", "an instrument on USB"),
)
_OWN = About("of a user's own", "", "", "", "by its author, or not")


class Known(NamedTuple):
    """A back end: its name, its kind (rig or positioner), and its description."""

    name: str
    kind: str
    about: About


class Found(NamedTuple):
    """A device that was found: where, its description, and the name of its back end, if known."""

    where: str
    says: str
    name: str = ""


def known_devices() -> list[Known]:
    """Return the back ends, including those of installed packages."""
    return [Known(name, kind, _about(client)) for name, kind, client in _clients()]


def attached_devices() -> list[Found]:
    """Return serial ports, USB instruments and NI devices of this machine. Nothing is sent to any port."""
    found = [Found(port, words) for pattern, words in _FILES for port in sorted(glob.glob(pattern))]
    for name, _, client in _clients():
        if hasattr(client, "attached"):
            found += [Found(where, model, name) for where, model in _asked(client.attached)]
    return found


def probe(host: str, port: int | None = None, timeout: float = 0.5) -> list[Found]:
    """Ask an address which of the known controllers it is. Only a controller that identifies itself gets more
    requests.

    Args:
        host: name or address.
        port: TCP port; by default the makers' ports.
        timeout: s, for each answer.
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
    """Yield name, kind and class of each back end."""
    for kind in (registry.rigs, registry.positioners):
        yield from ((name, kind.noun, client) for name, client in kind.all())


def _about(client: Any) -> About:
    return getattr(client, "about", _OWN)


def _identity(client: Any, host: str, port: int, timeout: float) -> str:
    """Return what the device at an address calls itself. Raises RigError if it is not the client's."""
    if hasattr(client, "identify"):
        return client.identify(host, port, timeout)
    opened = client(host, port=port, timeout=timeout)
    opened.close()
    return (opened.capabilities if hasattr(opened, "capabilities") else opened.ranges).name


def _asked(what: Callable[[], list[Any]]) -> list[Any]:
    """Return a library's answer; empty if it is not installed, fails, or does not answer in time."""
    made: list[Any] = []

    def ask() -> None:
        try:
            made.extend(what())
        except Exception:  # a library without its driver fails in many ways
            return

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    thread.join(_PATIENCE)
    return list(made)
