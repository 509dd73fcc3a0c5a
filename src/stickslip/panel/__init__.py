"""The control panel in the browser: routes, one stream and the page's files; no physics.

Every number that it shows comes from the public functions that the command line calls.
"""

from .server import create_app as create_app
