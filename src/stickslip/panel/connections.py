"""Connections of the panel's server, limited in number and in idle time."""

from __future__ import annotations

import logging
from asyncio import CancelledError, TimerHandle
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 400  # open at a time
# s between two checks of a connection. A new one must have sent the head of a request by the first check.
PATIENCE = 10.0
# Number of checks without progress after which a connection is closed that has not sent the whole request, or
# not read the answer.
_BODY = 6


class BoundedConnection(H11Protocol):
    """HTTP connection of uvicorn with limits.

    A connection is closed if it stays silent or sends only half a request. If more than `MOST_CONNECTIONS`
    are open, the oldest idle one is closed at once, or the new one if none is idle.
    """

    _timer: TimerHandle | None = None
    _served: Any = None  # the request at the last check
    _looks = 0  # checks in a row at which the client had made no progress

    def connection_made(self, transport: Any) -> None:
        """Start the timer of a new connection; close the oldest idle one if there are too many."""
        super().connection_made(transport)
        self.since = self.loop.time()
        if len(self.connections) > MOST_CONNECTIONS:
            waiting = (one for one in self.connections if isinstance(one, BoundedConnection) and one.idle)
            oldest = min(waiting, key=lambda one: one.since, default=self)
            oldest.transport.abort()
        self._timer = self.loop.call_later(PATIENCE, self._look)

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timer of a closed connection."""
        if self._timer is not None:
            self._timer.cancel()
        super().connection_lost(exc)

    @property
    def idle(self) -> bool:
        """Return True if the connection has no request that waits for an answer."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def _waits_for_the_server(self) -> bool:
        """Return True if the request is complete and its answer has not started: a busy machine may need
        minutes."""
        return self.cycle is not None and not self.cycle.more_body and not self.cycle.response_started

    def _look(self) -> None:
        # The connection is closed already, or became a WebSocket, which has no time limit here.
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return
        waited = self.cycle is self._served and not self._waits_for_the_server
        self._looks = self._looks + 1 if waited else 0
        if (self.idle and (self.cycle is None or self._looks)) or self._looks >= _BODY:
            self.transport.abort()
            return
        self._served = self.cycle
        self._timer = self.loop.call_later(PATIENCE, self._look)


def server_config(app: Any) -> uvicorn.Config:
    """Return uvicorn's settings for the panel's application `app`, with limited connections."""
    made = uvicorn.Config(
        app,
        http=BoundedConnection,
        log_level="warning",
        ws_max_size=2**17,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    logging.getLogger("uvicorn.error").addFilter(_no_cancelled)
    return made


def _no_cancelled(record: logging.LogRecord) -> bool:
    """Return False for a log record with the traceback of a request that was cancelled at shutdown, so that
    it is not logged.

    Uvicorn logs the number of cancelled requests in a line of its own.
    """
    return not (record.exc_info and isinstance(record.exc_info[1], CancelledError))
