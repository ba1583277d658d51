"""Several cores within one process, in order and in bounded memory: numpy, zlib and hashlib let go of Python's lock."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import lru_cache, partial
from typing import TypeVar

Item = TypeVar("Item")
Made = TypeVar("Made")

_MOST = 4
"""Arithmetic on long arrays waits for memory beyond so many threads; and each thread holds arrays of its own."""

_inside = threading.local()


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
    with ThreadPoolExecutor(workers, thread_name_prefix="side_by_side") as pool:
        yield from _in_order_by(pool, work, items, workers)


def _in_order_by(
    pool: Executor, work: Callable[[Item], Made], items: Iterable[Item], workers: int
) -> Generator[Made, None, None]:
    """As `in_order`, by the threads of a pool that stays; what has not begun when an error is raised is called off."""
    begun: deque[Future[Made]] = deque()
    try:
        for item in items:
            begun.append(pool.submit(work, item))
            if len(begun) > workers:
                yield begun.popleft().result()
        while begun:
            yield begun.popleft().result()
    finally:
        for waiting in begun:
            waiting.cancel()


def threads() -> int:
    """How many threads of `shared_out` work at once."""
    return min(cores(), _MOST)


def shared_out(work: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """`work` done on every item, in order, by threads that stay; some items ahead of the one that is asked for.

    What comes out does not depend on how many cores there are. Work that is itself shared out stays in its thread. One
    item alone is done by the thread that asks, so that it may share out its parts.
    """
    alone = isinstance(items, Sized) and len(items) == 1
    if alone or threads() == 1 or getattr(_inside, "busy", False):
        yield from map(work, items)
        return
    yield from _in_order_by(_pool(), partial(_marked, work), items, threads())


def parts_of(count: int, most: int) -> list[slice]:
    """So many things in a row as up to `most` slices of nearly one size."""
    most = min(most, count)
    return [slice(count * i // most, count * (i + 1) // most) for i in range(most)]


def do_all(work: Callable[[Item], None], items: Iterable[Item]) -> None:
    """`work` done on every item, for what it writes."""
    deque(shared_out(work, items), maxlen=0)


def _marked(work: Callable[[Item], Made], item: Item) -> Made:
    _inside.busy = True
    return work(item)


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads(), thread_name_prefix="shared_out")


if hasattr(os, "register_at_fork"):  # the threads of a pool stay behind with the parent
    os.register_at_fork(after_in_child=_pool.cache_clear)
