"""The control panel in the browser: routes, one WebSocket stream and the page's files; no physics.

All its numbers come from the package's other modules. A notebook that only shows plots needs no server.
"""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
