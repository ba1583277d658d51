"""What is said to whoever is refused: a status and one clear line, as `{"error": "…"}`."""

from __future__ import annotations

import json
from collections.abc import Mapping

from starlette.types import Scope, Send


class RefusalError(Exception):
    """A request that is refused: HTTP status, one line, and headers that belong to that status."""

    def __init__(self, status: int, says: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(says)
        self.status, self.says, self.headers = status, says, headers or {}


def error_body(says: str) -> bytes:
    """The body of every answer that is an error."""
    return json.dumps({"error": says}, ensure_ascii=False).encode()


async def send_refusal(scope: Scope, send: Send, refusal: RefusalError) -> None:
    """Refuse a request, or a websocket before it is one."""
    kind = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
    body = error_body(refusal.says)
    headers = {"content-type": "application/json", "content-length": str(len(body)), **refusal.headers}
    pairs = [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers.items()]
    await send({"type": f"{kind}.start", "status": refusal.status, "headers": pairs})
    await send({"type": f"{kind}.body", "body": body})
