"""Access control of the page server: by address on the loopback interface, by token on any other."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")
POLICY_VIOLATION = 1008  # WebSocket close code (RFC 6455, section 7.4.1)
SAFE_METHODS = ("GET", "HEAD")  # methods that change nothing (RFC 9110, section 9.2.1)

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
    """The rule by which requests are allowed or refused.

    Attributes:
        port: Port of the server.
        token: Token that every request must carry; None for a server on the loopback interface.
    """

    port: int
    token: str | None = None

    def refusal(self, scope: Scope) -> str:
        """Reason for which a request is refused; "" if it is allowed.

        Any page that is open in a browser on this machine can send requests to the loopback interface. It cannot
        forge the Host header, which reveals DNS rebinding, nor the Origin header, which reveals cross-site requests.
        """
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if self.token is None and host not in {f"{name}:{self.port}" for name in LOOPBACK_NAMES}:
            return "this server accepts only requests to its own address"
        if self.token is not None and not hmac.compare_digest(self._presented_token(scope), self.token.encode()):
            return "the address lacks the token that the command printed"
        is_plain_read = scope["type"] == "http" and scope["method"] in SAFE_METHODS and origin is None
        if not is_plain_read and origin not in {f"http://{host}", f"https://{host}"}:
            return "this server accepts only requests from its own page"
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
        policy: The rule by which requests are allowed or refused.
    """

    def __init__(self, app: ASGIApp, policy: AccessPolicy) -> None:
        self._app = app
        self._policy = policy

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle an ASGI connection."""
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
