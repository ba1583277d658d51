"""Checks of every request: host, origin and body; and the headers of every response.

An unknown name in `Host` means that another domain was pointed at this machine (DNS rebinding). The port is not
checked, because it differs at the other end of an SSH tunnel.
"""

from __future__ import annotations

import asyncio
import ipaddress
import socket

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from benchctl.dashboard.web.answers import RefusalError, send_refusal

_LOOPBACK_NAMES = frozenset({"127.0.0.1", "::1", "localhost"})


def own_names(host: str) -> frozenset[str]:
    """Return the accepted host names of a server that listens at `host`, in addition to IP addresses."""
    if is_loopback(host):
        return _LOOPBACK_NAMES
    return _LOOPBACK_NAMES | {name.lower() for name in (host, socket.gethostname(), socket.getfqdn())}


def is_loopback(host: str) -> bool:
    """Return whether an address is reachable only from this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def refuse_foreign(headers: Headers, names: frozenset[str], *, origin_matters: bool) -> None:
    """Raise `RefusalError` for an unknown `Host`, or for a foreign `Origin` if it is sent and matters."""
    hosts = headers.getlist("host")
    if len(hosts) != 1 or not _is_ours(_name_of(hosts[0]), names):
        raise RefusalError(421, "this server has another name; open it by the address that benchctl serve printed")
    origins = headers.getlist("origin")
    if origin_matters and origins and [origin.lower() for origin in origins] != [f"http://{hosts[0].lower()}"]:
        raise RefusalError(403, "the request comes from another site's page; open the page of this server itself")


def _is_ours(name: str, names: frozenset[str]) -> bool:
    if name in names:
        return True
    if names == _LOOPBACK_NAMES:
        return False
    try:
        ipaddress.ip_address(name)  # an address cannot be pointed at another machine
    except ValueError:
        return False
    return True


def _name_of(host: str) -> str:
    """Return the name in a `Host` header in lower case, without port and brackets; empty if it is invalid."""
    name, colon, port = host.rpartition(":")
    if not colon or host.endswith("]"):
        name, port = host, "0"
    if not (port.isascii() and port.isdigit()):
        return ""
    if name.startswith("["):
        return name[1:-1].lower() if name.endswith("]") else ""
    return "" if ":" in name else name.lower()


MOST_HEADER_BYTES = 16 << 10
MOST_BODY_BYTES = 16 << 10
BODY_WITHIN_S = 10.0

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
REPORT_POLICY = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'self'"
"""A stored report was made by this suite, but the folder may come from anywhere: it must not run scripts."""

_HEADERS = {
    "Content-Security-Policy": PAGE_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
_CLOSE = {"connection": "close"}
_HARMLESS = frozenset({"GET", "HEAD"})


class Gate:
    """ASGI middleware that refuses foreign or too large requests, and adds headers to every response."""

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app, self._names = app, names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        harmless = scope["type"] == "http" and scope["method"] in _HARMLESS
        send = _dressed(send, private=scope["path"].startswith("/api"))
        try:
            if sum(len(name) + len(value) for name, value in scope["headers"]) > MOST_HEADER_BYTES:
                raise RefusalError(431, f"the headers are larger than {MOST_HEADER_BYTES} bytes", _CLOSE)
            refuse_foreign(Headers(scope=scope), self._names, origin_matters=not harmless)
            if scope["type"] == "http" and not harmless:
                receive = _once(await _body(scope, receive), receive)
        except RefusalError as refusal:
            await send_refusal(scope, send, refusal)
            return
        await self._app(scope, receive, send)


def _dressed(send: Send, *, private: bool) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
            if private:
                headers["Cache-Control"] = "no-store"
        await send(message)

    return sending


async def _body(scope: Scope, receive: Receive) -> bytes:
    """Read the complete body of a request; `RefusalError` if it is too large or late."""
    too_large = RefusalError(413, f"the body is larger than {MOST_BODY_BYTES} bytes", _CLOSE)
    length = Headers(scope=scope).get("content-length", "0")
    if not length.isdigit() or int(length) > MOST_BODY_BYTES:
        raise too_large
    body = b""
    try:
        async with asyncio.timeout(BODY_WITHIN_S):
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    raise RefusalError(400, "the body ended before its end", _CLOSE)
                body += bytes(message.get("body", b""))
                if len(body) > MOST_BODY_BYTES:
                    raise too_large
                if not message.get("more_body", False):
                    return body
    except TimeoutError as err:
        raise RefusalError(408, "the body did not come in time", _CLOSE) from err


def _once(body: bytes, receive: Receive) -> Receive:
    """Return a receive function that gives the body already read, then the following messages."""
    pending: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def receiving() -> Message:
        return pending.pop() if pending else await receive()

    return receiving
