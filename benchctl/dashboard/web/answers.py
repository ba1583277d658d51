"""Responses as JSON, serialized in the thread that read the data, or refusals with their status; and the thread pools.

The threads are daemons: the end of the program does not wait for a recording that is still being read.
"""

from __future__ import annotations

import asyncio
import json
import queue
import threading
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from starlette.responses import Response
from starlette.types import Scope, Send

from benchctl.documents import json_values

T = TypeVar("T")

_Job = tuple[asyncio.AbstractEventLoop, "asyncio.Future[Any]", Callable[[], Any]]


class Readers:
    """A pool: `threads` jobs at once, `waiting` more in the queue, others refused; cancelled jobs are not started."""

    def __init__(self, name: str, *, threads: int, waiting: int, within_s: float = 30.0) -> None:
        self._jobs: queue.Queue[_Job] = queue.Queue(waiting)
        self._within_s = within_s
        for number in range(threads):
            threading.Thread(target=self._work, name=f"{name}-{number}", daemon=True).start()

    async def run(self, job: Callable[[], T]) -> T:
        """Return what a job returns, or raise its exception.

        Raises
        ------
        RefusalError
            503, if too many jobs are waiting, or the result does not arrive in time.
        """
        loop = asyncio.get_running_loop()
        future: asyncio.Future[T] = loop.create_future()
        try:
            self._jobs.put_nowait((loop, future, job))
            async with asyncio.timeout(self._within_s):  # Python 3.11's wait_for may swallow a cancellation
                return await future
        except (queue.Full, TimeoutError) as err:
            raise RefusalError(503, "too many requests at once; try again in a moment", {"retry-after": "2"}) from err

    def _work(self) -> None:
        while True:
            loop, future, job = self._jobs.get()
            if future.cancelled():
                continue
            try:
                result, error = job(), None
            except Exception as err:  # the caller gets it, as if it had called the job itself
                result, error = None, err
            try:
                loop.call_soon_threadsafe(_settle, future, result, error)
            except RuntimeError:  # the loop has ended
                return


def _settle(future: asyncio.Future[Any], result: object, error: Exception | None) -> None:
    if future.done():
        return
    if error is not None:
        future.set_exception(error)
    else:
        future.set_result(result)


class RefusalError(Exception):
    """A refused request: HTTP status, a message of one line, and headers that belong to the status."""

    def __init__(self, status: int, message: str, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(message)
        self.status, self.message, self.headers = status, message, headers or {}


def error_body(message: str) -> bytes:
    """Return the body of an error response."""
    return json.dumps({"error": message}, ensure_ascii=False).encode()


async def send_refusal(scope: Scope, send: Send, refusal: RefusalError) -> None:
    """Refuse a request, or a websocket before the handshake is complete."""
    kind = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
    body = error_body(refusal.message)
    headers = {"content-type": "application/json", "content-length": str(len(body)), **refusal.headers}
    pairs = [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers.items()]
    await send({"type": f"{kind}.start", "status": refusal.status, "headers": pairs})
    await send({"type": f"{kind}.body", "body": body})


def json_text(value: Any) -> str:
    """Return a value as JSON; NaN and infinity, which JSON lacks, become null."""
    try:
        return _dumped(value)
    except ValueError:
        return _dumped(json_values(value))


async def answer(readers: Readers, read: Callable[[], Any]) -> Response:
    """Return the result of `read` as a JSON response; it runs in one of the `readers`."""
    body = await readers.run(lambda: json_text(read()).encode())
    return Response(body, media_type="application/json")


def _dumped(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
