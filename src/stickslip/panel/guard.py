"""Access to the panel: hosts, origins, tokens and their roles, the size of requests, and security headers of
answers."""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from starlette.exceptions import HTTPException

from ..quantities.registry import nothing_run
from .asking import Asker, asked_by, shown
from .roles import enough, least_role

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]"})
LARGEST_BODY = 32 * 2**20  # largest size of a request, bytes; uploaded recordings are the largest requests
PENALTY = 1.0  # delay of the answer to a wrong token, s
# Largest number of wrong tokens from one address that wait for their answer. Further ones are refused at
# once.
MOST_WRONG = 5
_COOKIE = "stickslip_panel"
# The browser may load files of this server only: no inline script or style, no eval, no other host.
_HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-cache",
}


class Guard:
    """ASGI middleware that checks every request before the application sees it.

    It refuses a wrong host (status 421), a page of another origin or a role that is too low (403), and a
    missing or wrong token (401, or 429 after too many). A request that is too large is refused with 413.
    Answers get security headers.

    Args:
        app: the guarded application.
        hosts: names that the Host header may have. A foreign DNS name that points to this machine is refused.
        any_address: True to accept also any numeric address, for a panel that is served to a network with a
            token.
        tokens: role of each token (see `roles`). A client sends its token in the header "Authorization:
            Bearer", as a cookie, or once as ``/?token=``, which sets the cookie. Without tokens every client
            has the role "maintain".
        largest_body: largest size of a request, bytes.
    """

    def __init__(
        self,
        app: Any,
        hosts: frozenset[str] = LOOPBACK,
        any_address: bool = False,
        tokens: Mapping[str, str] | None = None,
        largest_body: int = LARGEST_BODY,
    ) -> None:
        self._app, self._hosts, self._any_address = app, hosts, any_address
        self._tokens, self._largest = dict(tokens or {}), largest_body
        self._wrong: Counter[str] = Counter()  # number of wrong tokens that wait for their answer, by address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        # A request runs no user's Python file that was not named when the panel started.
        with nothing_run():
            await self._guarded(scope, receive, send)

    async def _guarded(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        token = self._shown(scope, headers)
        role = self._tokens.get(token, "" if self._tokens else "maintain")
        refused = self._refused(scope, headers, role)
        if refused:
            if refused[0] == 401:
                refused = await self._slowly(scope, headers, refused)
            await _answer(scope, receive, send, *refused)
            return
        address = (scope.get("client") or ("",))[0]
        with asked_by(Asker(shown(headers.get("x-client", "")), address, role)):
            if scope["type"] == "websocket":
                await self._app(scope, receive, send)
                return
            await self._http(scope, receive, send, token)

    async def _slowly(
        self, scope: Scope, headers: dict[str, str], refused: tuple[int, str]
    ) -> tuple[int, str]:
        """Return the refusal (status and reason), after `PENALTY` seconds if a wrong token was sent.

        The delay makes guessing tokens slow.
        """
        if not any(_offered(scope, headers)):
            return refused
        address = (scope.get("client") or ("",))[0]
        self._wrong[address] += 1
        try:
            await asyncio.sleep(PENALTY)
        finally:
            self._wrong[address] -= 1
            if not self._wrong[address]:
                del self._wrong[address]
        return refused

    async def _http(self, scope: Scope, receive: Receive, send: Send, token: str) -> None:
        if token and scope["path"] == "/" and b"token=" in scope["query_string"]:
            cookie = f"{_COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/"
            await _answer(scope, receive, send, 303, "", {"location": "/", "set-cookie": cookie})
            return
        taken = 0

        async def counted() -> MutableMapping[str, Any]:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > self._largest:
                raise HTTPException(413, self._too_large())
            return message

        async def headed(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                present = {name for name, _ in message["headers"]}
                more = [(k.encode(), v.encode()) for k, v in _HEADERS.items() if k.encode() not in present]
                message = {**message, "headers": [*message["headers"], *more]}
            await send(message)

        await self._app(scope, counted, headed)

    def _too_large(self) -> str:
        return f"a request may have up to {self._largest / 2**20:.3g} MiB"

    def _refused(self, scope: Scope, headers: dict[str, str], role: str) -> tuple[int, str] | None:
        """Return HTTP status and reason of a refusal; None if the request may pass.

        Args:
            scope: ASGI scope of the request.
            headers: headers of the request, with names in lower case.
            role: role of the token, "" without a valid token.
        """
        host = headers.get("host", "").lower()
        if not self._known(host):
            return 421, "this panel does not answer under that host name"
        origin = headers.get("origin")
        if origin is not None and origin.lower() not in (f"http://{host}", f"https://{host}"):
            return 403, "a page of another origin may not use this panel"
        if not role:
            # A valid token never waits for wrong ones from the same address, which many users may share
            # (tunnel).
            if self._wrong.get((scope.get("client") or ("",))[0], 0) >= MOST_WRONG:
                return 429, "too many wrong tokens: wait a moment"
            return 401, "the panel needs its token: open the address that the command printed"
        least = least_role(scope.get("method", "GET"), scope["path"])
        if not enough(role, least):
            return 403, f"this needs the role {least}, and your token is one to {role}"
        length = headers.get("content-length", "0")
        if not length.isdecimal() or int(length) > self._largest:
            return 413, self._too_large()
        return None

    def _known(self, host: str) -> bool:
        name = host if host.endswith("]") else host.rsplit(":", 1)[0]
        if name in self._hosts:
            return True
        if not self._any_address:
            return False
        try:
            ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return False
        return True

    def _shown(self, scope: Scope, headers: dict[str, str]) -> str:
        """Return the valid token that a request sends, "" for none.

        Tokens are compared in constant time, so that the delay of the answer does not help to guess a token.
        """
        offered, found = _offered(scope, headers), ""
        for token in self._tokens:
            if any(hmac.compare_digest(one.encode(), token.encode()) for one in offered):
                found = token
        return found


def _offered(scope: Scope, headers: dict[str, str]) -> list[str]:
    """Return the tokens that a request sends in its header ("" for none) and in its cookie, if it has one.

    A token in the page's address replaces both, because the cookie may be of another role.
    """
    if scope["path"] == "/" and b"token=" in scope["query_string"]:
        return parse_qs(scope["query_string"].decode("latin-1")).get("token", [])
    try:
        cookie = SimpleCookie(headers.get("cookie", "")).get(_COOKIE)
    except CookieError:
        cookie = None
    bearer = headers.get("authorization", "").removeprefix("Bearer ")
    return [bearer, cookie.value] if cookie else [bearer]


async def _answer(
    scope: Scope, receive: Receive, send: Send, status: int, text: str, headers: dict[str, str] | None = None
) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": text})
        return
    body = text.encode()
    all_headers = {"content-type": "text/plain; charset=utf-8", "content-length": str(len(body))}
    all_headers |= _HEADERS | (headers or {})
    encoded = [(name.encode(), value.encode()) for name, value in all_headers.items()]
    await send({"type": "http.response.start", "status": status, "headers": encoded})
    await send({"type": "http.response.body", "body": body})
