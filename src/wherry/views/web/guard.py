"""Who may talk to the server: this machine's own pages, or whoever knows the token."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
POLICY_VIOLATION = 1008  # RFC 6455, 7.4.1
SAFE_METHODS = ("GET", "HEAD")

HEADERS = {
    b"cache-control": b"no-store",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
    b"x-frame-options": b"DENY",
}


@dataclass(frozen=True, slots=True)
class Door:
    """Who is let in.

    Attributes:
        port: The server's port.
        token: What everyone has to know; None for a server that only this machine can reach.
    """

    port: int
    token: str | None = None

    def refusal(self, scope: Scope) -> str:
        """Why a request is refused, or nothing.

        A page from elsewhere, opened in this machine's browser, reaches the loopback too. It cannot forge Host, so a
        name of its own that it has pointed here (DNS rebinding) is refused; and a browser tells its Origin.
        """
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self.token is None and host not in {f"{name}:{self.port}" for name in LOOPBACK}:
            return "this server answers only to its own address"
        if self.token is not None and not hmac.compare_digest(self._given_token(scope), self.token.encode()):
            return "the address lacks the token that the command printed"
        asks_only = scope["type"] == "http" and scope["method"] in SAFE_METHODS and origin is None
        if not asks_only and origin not in {f"http://{host}", f"https://{host}"}:
            return "this server answers only to its own page"
        return ""

    @staticmethod
    def _given_token(scope: Scope) -> bytes:
        values = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])
        given: str = values[0]
        return given.encode()


class Guard:
    """An ASGI application that lets through what the door lets in, and adds headers that keep browsers careful.

    Args:
        app: What is guarded.
        door: Who is let in.
    """

    def __init__(self, app: ASGIApp, door: Door) -> None:
        self._app = app
        self._door = door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """As every ASGI application."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._door.refusal(scope)
        if not refusal:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": refusal})
        else:
            await PlainTextResponse(f"Refused: {refusal}.\n", status_code=403)(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    """Send every response with the headers."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *HEADERS.items()]
        await send(message)

    return send_with_headers
