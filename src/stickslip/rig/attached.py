"""Known back ends, and devices that are connected to this machine or answer on the network."""

from __future__ import annotations

import glob
import importlib
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from ..quantities import registry
from .protocols import About, RigError
from .scpi import ScpiInstrument

_PATIENCE = 3.0  # s, longest wait for an answer of a library
_PORTS = {"nv200": 23, "mcs2": 55551, "anc300": 7230, "e871": 50000}  # the makers' default ports
_SCPI = {5025: "scpi", 5555: "scpi", 4000: "scpi", 5000: "redpitaya"}  # ports whose devices answer to *IDN?
_FILES = (
    ("/dev/ttyUSB*", "a serial port"),
    ("/dev/ttyACM*", "a serial port"),
    ("/dev/tty.usb*", "a serial port"),
    ("/dev/usbtmc*", "an instrument on USB"),
)
_PROBES = ("nv200", "mcs2", "anc300", "kim101", "e871")


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
    made = []
    for kind, of in (("rig", registry.rigs), ("positioner", registry.positioners)):
        for name, thing in of.all():
            unsaid = About("of a user's own", "", "", "", "by its author, or not")
            made.append(Known(name, kind, getattr(thing, "about", unsaid)))
    return made


def attached_devices() -> list[Found]:
    """Return serial ports, USB instruments and NI devices of this machine. Nothing is sent to any port."""
    found = [Found(port, words) for pattern, words in _FILES for port in sorted(glob.glob(pattern))]
    return [*found, *(Found(name, model, "daqmx") for name, model in _asked(_ni_devices))]


def probe(host: str, port: int | None = None, timeout: float = 0.5) -> list[Found]:
    """Ask an address which of the known controllers it is. Only a controller that identifies itself gets more
    requests.

    Args:
        host: name or address.
        port: TCP port; by default the makers' ports.
        timeout: s, for each answer.
    """
    found = []
    for name in _PROBES:
        at = _PORTS.get(name) if port is None else port
        if at is None:
            continue
        try:
            opened = _opened(name, host, at, timeout)
        except RigError:
            continue
        said = opened.capabilities.name if hasattr(opened, "capabilities") else opened.ranges.name
        opened.close()
        found.append(Found(f"{host}:{at}", said, name))
        if port is not None:
            return found
    for at in _SCPI if port is None else (port,):
        with suppress(RigError):
            asked = ScpiInstrument("instrument", host, at, timeout)
            name = "redpitaya" if "REDPITAYA" in asked.identity.upper() else _SCPI.get(at, "scpi")
            found.append(Found(f"{host}:{at}", asked.identity, name))
            asked.close()
    return found


def _opened(name: str, host: str, port: int, timeout: float) -> Any:
    made = (registry.rigs if name == "nv200" else registry.positioners).find(name)
    if name == "kim101":
        return made(f"{host}:{port}", timeout=timeout)
    return made(host, port=port, timeout=timeout)


def _ni_devices() -> list[tuple[str, str]]:
    system = importlib.import_module("nidaqmx.system").System.local()
    return [(device.name, device.product_type) for device in system.devices]


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
