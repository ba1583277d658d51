"""Work on long arrays shared out over the cores: numpy and scipy let go of the interpreter while they are at one.

What comes out does not depend on how many cores there are: each piece of work is done by itself, and the results come
in the order of the pieces.
"""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from typing import TypeVar

from benchctl.side_by_side import cores as all_cores
from benchctl.side_by_side import in_order_by

Item = TypeVar("Item")
Result = TypeVar("Result")

_MOST = 4
"""Beyond so many threads the memory, not the arithmetic, is what they wait for; and each holds arrays of its own."""

_inside = threading.local()


def cores() -> int:
    """How many threads work at once."""
    return min(all_cores(), _MOST)


def shared_out(work: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """`work` done on every item, in turn; some items ahead of the one that is asked for, but never many.

    Work that is itself shared out stays in its thread. One item alone is done by the thread that asks, so that it may
    share out its parts.
    """
    alone = isinstance(items, Sized) and len(items) == 1
    if alone or cores() == 1 or getattr(_inside, "busy", False):
        yield from map(work, items)
        return
    yield from in_order_by(_pool(), partial(_marked, work), items, cores())


def parts_of(count: int, most: int) -> list[slice]:
    """So many things in a row as up to `most` slices of nearly one size."""
    most = min(most, count)
    return [slice(count * i // most, count * (i + 1) // most) for i in range(most)]


def do_all(work: Callable[[Item], None], items: Iterable[Item]) -> None:
    """`work` done on every item, for what it writes."""
    deque(shared_out(work, items), maxlen=0)


def _marked(work: Callable[[Item], Result], item: Item) -> Result:
    _inside.busy = True
    return work(item)


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(cores(), thread_name_prefix="diagnosis")


if hasattr(os, "register_at_fork"):  # the threads of a pool stay behind with the parent
    os.register_at_fork(after_in_child=_pool.cache_clear)
