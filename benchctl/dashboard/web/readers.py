"""Threads that read files for the event loop, a few at once: who asks too much waits, and only they.

They are daemons: the end of the program does not wait for a recording that is still being read.
"""

from __future__ import annotations

import asyncio
import queue
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from benchctl.dashboard.web.refusal import RefusalError

T = TypeVar("T")

_Job = tuple[asyncio.AbstractEventLoop, "asyncio.Future[Any]", Callable[[], Any]]


class Readers:
    """`threads` jobs at once, `waiting` more in the queue, the rest refused; a job nobody waits for is not begun."""

    def __init__(self, name: str, *, threads: int, waiting: int, within_s: float = 30.0) -> None:
        self._jobs: queue.Queue[_Job] = queue.Queue(waiting)
        self._within_s = within_s
        for number in range(threads):
            threading.Thread(target=self._work, name=f"{name}-{number}", daemon=True).start()

    async def run(self, job: Callable[[], T]) -> T:
        """What a job returns or raises.

        Raises
        ------
        RefusalError
            503, where too many are waiting, or the answer does not come in time.
        """
        loop = asyncio.get_running_loop()
        future: asyncio.Future[T] = loop.create_future()
        try:
            self._jobs.put_nowait((loop, future, job))
            return await asyncio.wait_for(future, self._within_s)
        except (queue.Full, TimeoutError) as err:
            raise RefusalError(
                503, "too much is asked for at once; try again in a moment", {"retry-after": "2"}
            ) from err

    def _work(self) -> None:
        while True:
            loop, future, job = self._jobs.get()
            if future.cancelled():
                continue
            try:
                result, error = job(), None
            except Exception as err:  # whoever asked is told, as if it had called the job itself
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
