"""Control of the rig: one page has control, and only its requests may drive the rig or change its experiment.

Other pages watch, and may ask for control. Every page may stop the rig. Each page has a secret, known only to
the page and the server. Other pages know it by the public name that `shown` makes of the secret.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable

from .asking import shown
from .stream import Client, Hub, Message

PATIENCE = 10.0  # time for which a page without connection keeps control, s: it may be reloading


class ControlError(ValueError):
    """Refusal of a request: another page has control of the rig, or the request names no page."""


class Control:
    """Record of which page controls the rig. Every change is sent to all pages.

    On construction it adds to `hub` its greeting, and the handlers of the messages "ask_control" and
    "hand_over". `clock` returns the present time, s.

    Attributes:
        holder: secret of the page in control, "" if no page has control.
        asking: secret of the page that asks for control, "" if no page does.
        gone: functions without arguments, called by `watch` when the page in control lost its connection and
            did not come back within `PATIENCE`.
    """

    def __init__(self, hub: Hub, clock: Callable[[], float] = time.monotonic) -> None:
        self.holder = self.asking = ""
        self.gone: list[Callable[[], None]] = []
        self._hub, self._clock = hub, clock
        self._seen = 0.0
        self._lock = threading.Lock()
        hub.greetings.append(lambda client, said: [self._message()])
        hub.hears["ask_control"] = lambda client, said: self.ask(client.identity)
        hub.hears["hand_over"] = lambda client, said: self.hand_over(client)

    def ask(self, identity: str) -> None:
        """Give control to the page with the secret `identity` if control is free; otherwise note its request.

        The state is then sent to all pages, so that the page in control can show the request. A request of
        the page in control changes nothing.
        """
        with self._lock:
            if self.holder:
                self.asking = identity if identity not in ("", self.holder) else self.asking
            elif identity:
                self._give(identity)
        self._hub.send(self._message())

    def hand_over(self, client: Client) -> None:
        """Give control to the page that asked for it, or to no page if none asked.

        `client` is the page that hands over. Without control of its own, it changes nothing.
        """
        with self._lock:
            if self.holder == client.identity:
                self._give(self.asking)
        self._hub.send(self._message())

    def need(self, identity: str) -> None:
        """Check that a page has control of the rig, before its request is executed.

        The page gets control if control is free; this is sent to all pages. `identity` is the page's secret,
        from the header X-Client.

        Raises:
            ControlError: another page has control, or `identity` is empty.
        """
        with self._lock:
            if not identity:
                raise ControlError("a request must say in X-Client who makes it")
            if self.holder == identity:
                return
            if self.holder:
                raise ControlError("another page controls the rig: ask it for control, at the top")
            self._give(identity)
        self._hub.send(self._message())

    def _give(self, identity: str) -> None:
        self.holder, self.asking, self._seen = identity, "", self._clock()

    def _lost(self) -> bool:
        """Return True if a page has control and has had no connection for `PATIENCE` seconds.

        Also note the time at which the page in control was last connected.
        """
        if any(client.identity == self.holder for client in self._hub.clients):
            self._seen = self._clock()
        return self.holder != "" and self._clock() - self._seen > PATIENCE

    def watch(self) -> None:
        """Take control from a page that has had no connection for `PATIENCE` seconds. Called once a second.

        Control goes to the page that asked for it, or to no page; then the functions in `gone` are called.
        """
        with self._lock:
            if not self._lost():
                return
            self._give(self.asking)
        self._hub.send(self._message())
        for act in self.gone:
            act()

    def _message(self) -> Message:
        return json.dumps({"kind": "control", "holder": shown(self.holder), "asking": shown(self.asking)})
