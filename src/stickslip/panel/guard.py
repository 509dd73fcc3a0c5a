"""Access to the panel: hosts, origins, tokens, the size of requests, and security headers of answers."""

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
LARGEST_BODY = 32 * 2**20  # bytes of a request; the largest are uploaded recordings
PENALTY = 1.0  # s of delay of the answer to a wrong token
MOST_WRONG = 5  # wrong tokens that may wait at a time from one address; further ones are refused at once
_COOKIE = "stickslip_panel"
# The page's own files only: no inline script or style, no eval, no other host.
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

    Args:
        app: the guarded application.
        hosts: names that the Host header may have. A foreign DNS name that points to this machine is refused.
        any_address: also accept any numeric address, for a panel that is served to a network with a token.
        tokens: the role of each token (see `roles`). A client sends one as a bearer, as a cookie, or once as
            ``/?token=``. Without tokens every client has the role "maintain".
        largest_body: bytes of a request.
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
        self._wrong: Counter[str] = Counter()  # wrong tokens that wait for their answer, by address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        with nothing_run():  # requests run no file that was not named when the panel started
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
        """Return HTTP status and reason if the request must be refused, else None.

        `role` is the token's, "" without a valid token.
        """
        host = headers.get("host", "").lower()
        if not self._known(host):
            return 421, "this panel does not answer under that host name"
        origin = headers.get("origin")
        if origin is not None and origin.lower() not in (f"http://{host}", f"https://{host}"):
            return 403, "a page of another origin may not use this panel"
        if not role:
            # A valid token never waits, however many wrong ones come from its address, for example through a
            # tunnel.
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
        """Return the valid token of a request, "" without one; compared in constant time."""
        offered, found = _offered(scope, headers), ""
        for token in self._tokens:
            if any(hmac.compare_digest(one.encode(), token.encode()) for one in offered):
                found = token
        return found


def _offered(scope: Scope, headers: dict[str, str]) -> list[str]:
    """Return the tokens that a request sends: "" for an absent bearer, and no entry for an absent cookie.

    A token in the page's address replaces the others, because the cookie may have another role.
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
