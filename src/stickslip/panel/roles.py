"""Roles of tokens. Each role may also do what the roles before it may do.

- watch: see everything, stop the rig, disarm it, withdraw a permit
- operate: control the rig, and write into the folder
- maintain: change limits, and choose the rig
"""

from __future__ import annotations

from .asking import asking

ROLES = ("watch", "operate", "maintain")
# Requests (POST) that the role "watch" may make: they write nothing and move nothing, or only make the rig
# safer. It may also make every GET request.
_WATCH = frozenset(
    {
        *("/quantity", "/bench/stop", "/bench/window", "/interlock/disarm", "/interlock/permit"),
        *("/api/design/map", "/api/design/check", "/api/design/motion"),
        *("/api/explore/motion", "/api/explore/steps", "/api/explore/python", "/api/move/response"),
        *("/history/detail", "/history/differences", "/history/overlay", "/recordings/show"),
        *("/sequence/check", "/studies/state", "/studies/picture"),
    }
)
_MAINTAIN = frozenset({"/bench/rig"})
SAID_BY_ALL = frozenset({"emergency_stop", "greet"})  # messages on the stream that watchers may send


class RoleError(ValueError):
    """The asker's role is too low for the request."""


def least_role(method: str, path: str) -> str:
    """Return the least role that a request needs."""
    if method in ("GET", "HEAD") or path in _WATCH:
        return "watch"
    return "maintain" if path in _MAINTAIN else "operate"


def enough(role: str, least: str) -> bool:
    """Return True if a role includes another one."""
    return ROLES.index(role) >= ROLES.index(least)


def need_role(least: str) -> None:
    """Raise RoleError unless the current asker has at least that role."""
    if not enough(asking().role, least):
        raise RoleError(f"this needs the role {least}, and your token is one to {asking().role}")
