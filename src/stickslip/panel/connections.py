"""Connections of browsers to the panel's server, limited in number and in idle time."""

from __future__ import annotations

import logging
from asyncio import CancelledError, TimerHandle
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 400  # largest number of connections open at the same time
# Interval between two checks of a connection, s. By the first check a new connection must have sent the head
# of a request.
PATIENCE = 10.0
# Number of successive checks that find the same unfinished request, after which a connection is closed. It
# applies to a request that is not complete and to an answer that is not read to its end, also if they proceed
# slowly.
_BODY = 6


class BoundedConnection(H11Protocol):
    """HTTP connection of uvicorn with a time limit; the number of connections is limited, too.

    A connection is closed if it is silent, or if sending a request or reading its answer takes too long (see
    `PATIENCE` and `_BODY`). If more than `MOST_CONNECTIONS` are open, the oldest one without a request in
    progress is closed at once, which may be the new one.
    """

    _timer: TimerHandle | None = None
    _served: Any = None  # last request, as it was at the last check; None for none
    _looks = 0  # number of successive checks with the same request, answered or waiting for the client

    def connection_made(self, transport: Any) -> None:
        """Start the timer of a new connection.

        If more than `MOST_CONNECTIONS` are open, close the oldest one without a request in progress, which
        may be the new one.
        """
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
        """Return True if no request on this connection waits for an answer."""
        return self.cycle is None or self.cycle.response_complete

    @property
    def _waits_for_the_server(self) -> bool:
        """Return True if the client has sent its whole request and the server has not started to answer.

        Such a connection is not closed, because a busy machine may need minutes for an answer.
        """
        return self.cycle is not None and not self.cycle.more_body and not self.cycle.response_started

    def _look(self) -> None:
        # Nothing is left to check if the connection is closed, or has become a WebSocket, which has no time
        # limit here.
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
    """Return uvicorn's settings for the panel's application `app`: limited connections, few log lines.

    The function also filters uvicorn's log with `_no_cancelled`.
    """
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
    """Filter a log record of uvicorn: return False, "do not log", for a request cancelled at shutdown.

    Such a record carries the traceback of a CancelledError. Uvicorn also logs the number of cancelled
    requests, so nothing is lost.
    """
    return not (record.exc_info and isinstance(record.exc_info[1], CancelledError))
