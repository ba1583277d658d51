"""Several cores within one process, in order and in bounded memory: numpy, zlib and hashlib let go of Python's lock."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Made = TypeVar("Made")


def cores() -> int:
    """The processors that this process may use, where the system says so."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(work: Callable[[Item], Made], items: Iterable[Item], workers: int) -> Generator[Made, None, None]:
    """`work` of every item, in the order of the items; so many at a time, and one more that waits its turn.

    An error of one is raised where its result would stand; what had begun behind it is finished and dropped. One worker
    is the thread that asks.
    """
    if workers == 1:
        yield from map(work, items)
        return
    begun: deque[Future[Made]] = deque()
    with ThreadPoolExecutor(workers, thread_name_prefix="side_by_side") as pool:
        try:
            for item in items:
                if len(begun) > workers:
                    yield begun.popleft().result()
                begun.append(pool.submit(work, item))
            while begun:
                yield begun.popleft().result()
        finally:
            for waiting in begun:
                waiting.cancel()
