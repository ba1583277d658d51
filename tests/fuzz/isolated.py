"""Inputs given to parsers that rest on a library in C, each where its death costs nothing: in a forked process.

The child counts in memory that it shares; where it dies the parent knows by which input, and goes on with the next. A
death (a signal: a fault in C, or a kernel timer that ran out in a loop there) is told apart from a fault of this
project, which is an exception. `python -m tests.fuzz.isolated NAME INPUTS SECONDS FOLDER` does what `worker` does, with
random changes in place of a fuzzer's: what happens in C shows no coverage.
"""

from __future__ import annotations

import faulthandler
import hashlib
import json
import mmap
import os
import random
import resource
import signal
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.harness import (
    MEMORY_LIMIT_BYTES,
    SLOWEST_S,
    HangError,
    Harness,
    clear_workplace,
    harness,
    timed,
    workplace,
)
from tests.fuzz.mutate import mutated

_BATCH = 500
_SLEPT_S = 20.0
"""Of wall time: what hangs without using the processor."""
_PLACE = struct.Struct("qd")


@dataclass(slots=True)
class Isolated:
    """What became of inputs: how many were taken, which met an exception of ours, a death in C, or took too long."""

    inputs: int = 0
    slowest_s: float = 0.0
    peak_bytes: int = 0
    faults: list[tuple[bytes, str]] = field(default_factory=list)
    deaths: list[tuple[bytes, str]] = field(default_factory=list)
    slow: list[tuple[bytes, str]] = field(default_factory=list)


def run_isolated(one: Harness, made: Callable[[int], bytes], count: int, until: float = float("inf")) -> Isolated:
    """Give a harness the inputs `made(0)` to `made(count - 1)`, or as many as `time.monotonic()` allows."""
    found = Isolated()
    workplace()  # made here, so that all children share it and it is cleared with this process
    with mmap.mmap(-1, 4096) as shared:
        while found.inputs < count and time.monotonic() < until:
            _PLACE.pack_into(shared, 0, found.inputs, 0.0)
            last = min(count, found.inputs + _BATCH)
            status = _child(one, made, range(found.inputs, last), until, shared)
            place, slowest_s = _PLACE.unpack_from(shared, 0)
            found.slowest_s = max(found.slowest_s, slowest_s)
            if os.WIFSIGNALED(status):
                found.deaths.append((made(place), signal.Signals(os.WTERMSIG(status)).name))
            elif os.WEXITSTATUS(status):
                said = bytes(shared[_PLACE.size :]).split(b"\0")[0].decode()
                (found.slow if HangError.__name__ in said else found.faults).append((made(place), said))
            found.inputs = place + 1 if status else place
    found.peak_bytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )
    return found


def _child(one: Harness, made: Callable[[int], bytes], places: range, until: float, shared: mmap.mmap) -> int:
    """The status with which a child ended that took a batch, or as much of it as time allowed."""
    process = os.fork()
    if process:
        return os.waitpid(process, 0)[1]
    code = 1
    try:
        warnings.simplefilter("error")
        faulthandler.disable()  # a death is told by its signal
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for number in (signal.SIGPROF, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        slowest_s = 0.0
        for place in places:
            _PLACE.pack_into(shared, 0, place, slowest_s)
            if time.monotonic() > until:
                break
            signal.setitimer(signal.ITIMER_PROF, 2 * SLOWEST_S)
            signal.setitimer(signal.ITIMER_REAL, _SLEPT_S)
            slowest_s = max(slowest_s, timed(one, made(place)))
            _PLACE.pack_into(shared, 0, place + 1, slowest_s)
        code = 0
    except BaseException:  # a child must not go on where its parent is
        said = traceback.format_exc().encode("utf-8", "replace")[-3000:].replace(b"\0", b"?")
        shared[_PLACE.size : _PLACE.size + len(said) + 1] = said + b"\0"
    finally:
        os._exit(code)


def changes(one: Harness, seed: int) -> Callable[[int], bytes]:
    """The seeds and the corpus first, then random changes of them; the same for the same seed."""
    inputs = one.inputs()

    def made(place: int) -> bytes:
        if place < len(inputs):
            return inputs[place]
        chance = random.Random(f"{seed}, {place}")
        return mutated(chance.choice(inputs), inputs, one.tokens, chance)[: one.longest]

    return made


def main() -> None:
    name, inputs, seconds, folder = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    one = harness(name)
    begun = time.monotonic()
    found = run_isolated(one, changes(one, seed=inputs), inputs, begun + seconds if seconds else float("inf"))
    for kind, met in (("crash", found.faults), ("died", found.deaths), ("slow", found.slow)):
        for data, said in met:
            digest = hashlib.sha256(data).hexdigest()[:16]
            (folder / f"{kind}-{digest}").write_bytes(data)
            (folder / f"{kind}-{digest}.txt").write_text(said)
    told = {
        "inputs": found.inputs,
        "seconds": time.monotonic() - begun,
        "slowest_s": found.slowest_s,
        "crashes": len(found.faults),
        "deaths": len(found.deaths),
        "slow": len(found.slow),
    }
    (folder / "told.json").write_text(json.dumps(told))
    clear_workplace()


if __name__ == "__main__":
    main()
