"""The control panel in the browser: routes, one stream and the page's files; no physics.

Every number that it shows comes from the public functions that the command line calls.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .server import create_app as create_app


def __getattr__(name: str) -> Any:
    # A notebook that only wants the plots needs no server, and none of what it is made of.
    if name == "create_app":
        from .server import create_app

        return create_app
    raise AttributeError(name)
