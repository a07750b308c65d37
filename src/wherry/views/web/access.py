"""Access control of the page server: pages of this machine, or whoever presents the token."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
POLICY_VIOLATION = 1008  # close code of RFC 6455, section 7.4.1
SAFE_METHODS = ("GET", "HEAD")

SECURITY_HEADERS = {
    b"cache-control": b"no-store",
    b"cross-origin-opener-policy": b"same-origin",
    b"cross-origin-resource-policy": b"same-origin",
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
    b"x-frame-options": b"DENY",
}


@dataclass(frozen=True, slots=True)
class AccessPolicy:
    """Which requests are allowed.

    Attributes:
        port: Port of the server.
        token: Token that every request must carry; None for a server on the loopback interface.
    """

    port: int
    token: str | None = None

    def refusal(self, scope: Scope) -> str:
        """Why a request is refused; "" if it is allowed.

        A foreign page that is open in this machine's browser can send requests to the loopback interface, too. It
        cannot forge the Host header, which reveals DNS rebinding, nor Origin, which reveals cross-site requests.
        """
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self.token is None and host not in {f"{name}:{self.port}" for name in LOOPBACK_NAMES}:
            return "this server answers only to its own address"
        if self.token is not None and not hmac.compare_digest(self._presented_token(scope), self.token.encode()):
            return "the address lacks the token that the command printed"
        is_plain_read = scope["type"] == "http" and scope["method"] in SAFE_METHODS and origin is None
        if not is_plain_read and origin not in {f"http://{host}", f"https://{host}"}:
            return "this server answers only to its own page"
        return ""

    @staticmethod
    def _presented_token(scope: Scope) -> bytes:
        values = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])
        token: str = values[0]
        return token.encode()


class AccessMiddleware:
    """ASGI middleware that refuses requests by a policy and adds security headers to responses.

    Args:
        app: The wrapped application.
        policy: Which requests are allowed.
    """

    def __init__(self, app: ASGIApp, policy: AccessPolicy) -> None:
        self._app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle a request, as ASGI defines it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refusal = self._policy.refusal(scope)
        if not refusal:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": refusal})
        else:
            await PlainTextResponse(f"Refused: {refusal}.\n", status_code=403)(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    """A send function that adds the security headers to every response."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *SECURITY_HEADERS.items()]
        await send(message)

    return send_with_headers
