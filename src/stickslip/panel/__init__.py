"""The control panel in the browser: routes, one stream and the page's files; no physics.

Every number that it shows comes from the public functions that the command line calls. A notebook that only
wants the plots needs no server, and none of what it is made of.
"""

from .._lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
