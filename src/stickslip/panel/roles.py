"""Roles of tokens: who shows one may watch, operate or maintain.

watch       see everything, stop the rig, disarm it, withdraw a permit
operate     and control the rig, and write into the folder
maintain    and change limits, and choose the rig
"""

from __future__ import annotations

from .asking import asking

ROLES = ("watch", "operate", "maintain")
# Requests that write nothing and move nothing, and those that only make the rig safer; each GET is one too.
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
SAID_BY_ALL = frozenset({"emergency_stop", "greet"})  # what watchers may say on the stream


class RoleError(ValueError):
    """The role of who asks is not enough."""


def least_role(method: str, path: str) -> str:
    """Return the least role that a request needs."""
    if method in ("GET", "HEAD") or path in _WATCH:
        return "watch"
    return "maintain" if path in _MAINTAIN else "operate"


def enough(role: str, least: str) -> bool:
    """Whether a role is at least another one."""
    return ROLES.index(role) >= ROLES.index(least)


def need_role(least: str) -> None:
    """Raise RoleError unless who asks now has at least that role."""
    if not enough(asking().role, least):
        raise RoleError(f"this needs the role {least}, and your token is one to {asking().role}")
