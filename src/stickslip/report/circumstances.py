"""Circumstances of a report: date, command line, duration, machine, versions."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import PackageNotFoundError, version

from .._version import __version__

_LIBRARIES = ("numpy", "scipy", "xarray", "pandas", "h5netcdf", "matplotlib", "jinja2")


@dataclass(frozen=True)
class Circumstances:
    """Circumstances of a report.

    `made` is date and time in ISO 8601 with the time zone, `command` the user's command line ("" for none),
    and `elapsed` the duration of the work in s (None: not measured). `machine` describes system and
    processors in words. `versions` has the versions of stickslip, Python and libraries by name.
    """

    made: str
    command: str
    elapsed: float | None
    machine: str
    versions: dict[str, str]


def circumstances(command: str = "", elapsed: float | None = None) -> Circumstances:
    """Return the circumstances of a report: the present time, this machine, and versions of its libraries.

    `command` is the user's command line, `elapsed` the duration of the work in s (None: not measured).
    Libraries that are not installed are left out.
    """
    versions = {"stickslip": __version__, "Python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    machine = f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} processors"
    made = datetime.now().astimezone().isoformat(timespec="seconds")
    return Circumstances(made, command, elapsed, machine, versions)
