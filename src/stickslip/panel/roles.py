"""Roles of tokens, from least to most. Each role includes the roles before it.

- watch: see everything, stop the rig, disarm it, withdraw a permit
- operate: control the rig, write into the folder, and change the limit on heartbeats
- maintain: change the rig's other limits, and choose the rig
"""

from __future__ import annotations

from .asking import asking

ROLES = ("watch", "operate", "maintain")
# Paths of requests (POST) that the role "watch" may make, besides all GET requests. They neither write nor
# move anything, or only make the rig safer; the route that gives permits itself requires more.
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
# Messages on the stream that a client with the role "watch" may send.
SAID_BY_ALL = frozenset({"emergency_stop", "greet"})


class RoleError(ValueError):
    """Refusal of a request for which the role of the client's token is too low."""


def least_role(method: str, path: str) -> str:
    """Return the least role that a request needs; its route may require a higher one by `need_role`.

    `method` is its HTTP method, such as "POST", and `path` the path of its address.
    """
    if method in ("GET", "HEAD") or path in _WATCH:
        return "watch"
    return "maintain" if path in _MAINTAIN else "operate"


def enough(role: str, least: str) -> bool:
    """Return True if the role `role` includes the role `least`."""
    return ROLES.index(role) >= ROLES.index(least)


def need_role(least: str) -> None:
    """Raise RoleError unless the client whose request is being answered has at least the role `least`."""
    if not enough(asking().role, least):
        raise RoleError(f"this needs the role {least}, and your token is one to {asking().role}")
