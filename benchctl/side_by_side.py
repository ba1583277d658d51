"""Use several cores in one process, in order and with bounded memory; numpy, zlib and hashlib release Python's lock."""

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
"""With more threads, arithmetic on long arrays is limited by memory bandwidth; and each thread needs its own arrays."""

_inside = threading.local()


def cores() -> int:
    """Return the number of processors that this process may use, or all if the system does not report it."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(work: Callable[[Item], Made], items: Iterable[Item], workers: int) -> Generator[Made, None, None]:
    """Yield `work(item)` for every item, in order, with `workers` items at a time and one more waiting.

    An exception is raised in place of the item's result; later items in progress are completed and discarded. With one
    worker, the calling thread does the work.
    """
    if workers == 1:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(workers, thread_name_prefix="side_by_side") as pool:
        yield from _in_order_by(pool, work, items, workers)


def _in_order_by(
    pool: Executor, work: Callable[[Item], Made], items: Iterable[Item], workers: int
) -> Generator[Made, None, None]:
    """Like `in_order`, with the threads of a permanent pool; after an exception, items not yet begun are cancelled."""
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
    """Return the number of threads of `shared_out`."""
    return min(cores(), _MOST)


def shared_out(work: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """Yield `work(item)` for every item, in order, computed in advance by permanent threads.

    The result does not depend on the number of cores. Calls inside `work` run in the same thread. A single item is
    processed by the calling thread, so that its parts can be shared out.
    """
    alone = isinstance(items, Sized) and len(items) == 1
    if alone or threads() == 1 or getattr(_inside, "busy", False):
        yield from map(work, items)
        return
    yield from _in_order_by(_pool(), partial(_marked, work), items, threads())


def parts_of(count: int, most: int) -> list[slice]:
    """Divide `count` consecutive items into up to `most` slices of nearly equal size."""
    most = min(most, count)
    return [slice(count * i // most, count * (i + 1) // most) for i in range(most)]


def do_all(work: Callable[[Item], None], items: Iterable[Item]) -> None:
    """Call `work` on every item, for its side effects."""
    deque(shared_out(work, items), maxlen=0)


def _marked(work: Callable[[Item], Made], item: Item) -> Made:
    _inside.busy = True
    return work(item)


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads(), thread_name_prefix="shared_out")


if hasattr(os, "register_at_fork"):  # a forked child has no threads of the pool
    os.register_at_fork(after_in_child=_pool.cache_clear)
