"""What a fuzzer needs of a family of parsers: a function of bytes, inputs to begin with, and what counts as a fault.

A harness takes any bytes and returns. What a parser may say is a `BenchError` whose message a person can read; every
other exception, a death of the process, more than a second of processor time or more memory than `MEMORY_LIMIT_BYTES`
is a fault of the parser.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchctl_instruments.errors import BenchError

CORPUS = Path(__file__).parent / "corpus"
SLOWEST_S = 1.0
"""Of processor time: what else runs on the machine does not count."""
MEMORY_LIMIT_BYTES = 3 << 30
"""Of address space; numpy, scipy, h5py and the fuzzer itself take one of the three."""

_PREFIX = "benchctl-fuzz-"
_LONGEST_MESSAGE = 24_000
"""Characters; some readers tell the whole line of an instrument, 4096 bytes of it, as escapes."""


class HangError(Exception):
    """An input took too long."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Harness:
    """A family of parsers.

    `one_input` is given bytes. `seeds` are sound inputs, made anew by this very project, so that they are never out of
    date. `tokens` are what a fuzzer cannot guess. `longest` bounds an input in bytes. `weight` is its
    share of the inputs of a whole run: what is slow gets fewer. `native`: most of the
    work is done by a library in C that may die of an input, so that each must be given to a process that may.
    """

    name: str
    one_input: Callable[[bytes], None]
    seeds: Callable[[], list[bytes]]
    tokens: tuple[bytes, ...] = ()
    longest: int = 4096
    weight: int = 10
    native: bool = False

    def inputs(self) -> list[bytes]:
        """The seeds, and what the corpus keeps because it once mattered."""
        kept = sorted((CORPUS / self.name).glob("*"))
        return [*self.seeds(), *(path.read_bytes() for path in kept)]


def harness_names() -> list[str]:
    """The names of all harnesses: each is a module of that name, with its `HARNESS`."""
    return sorted(module.name for module in pkgutil.iter_modules([str(Path(__file__).parent / "harnesses")]))


def harness(name: str) -> Harness:
    """The harness of that name."""
    found: Harness = importlib.import_module(f"tests.fuzz.harnesses.{name}").HARNESS
    return found


def timed(one: Harness, data: bytes) -> float:
    """Give a harness one input; returns the processor time (s) that it took, raises `HangError` where that is long."""
    begun = time.process_time()
    one.one_input(data)
    took = time.process_time() - begun
    if took > SLOWEST_S:
        raise HangError(f"{one.name}: {len(data)} bytes took {took:.2f} s")
    return took


@contextmanager
def refusals() -> Iterator[None]:
    """What a parser may say to bytes that it cannot use: one message, not too long, that can be printed anywhere."""
    try:
        yield
    except BenchError as err:
        message = str(err)
        message.encode("utf-8")
        assert 0 < len(message) <= _LONGEST_MESSAGE, f"a message of {len(message)} characters: {message[:100]!r}"


@cache
def workplace() -> Path:
    """A folder for files, in memory where the system has such a place; it is this process's own."""
    return Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-", dir=_where()))


def clear_workplace(process: int | None = None) -> None:
    """Remove the folder of this process, or of one that has died, where it made one."""
    for folder in _where().glob(f"{_PREFIX}{process or os.getpid()}-*"):
        shutil.rmtree(folder, ignore_errors=True)
    workplace.cache_clear()


def _where() -> Path:
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else Path(tempfile.gettempdir())


def pieces(data: bytes) -> Iterator[bytes]:
    """The bytes behind the first, cut as the first byte says, into 16 pieces at most: as a stream brings them."""
    size = max(data[0] or len(data), len(data) // 16) if data else 1
    return (data[start : start + size] for start in range(1, len(data), size))
