"""One harness under atheris, in a process of its own: `python -m tests.fuzz.worker NAME INPUTS SECONDS FOLDER`.

Ends with 0 after so many inputs or seconds; dies at the first fault, whose input libFuzzer leaves in FOLDER. What it
has done stands in FOLDER/told.json: `inputs`, `seconds`, `slowest_s`, and `full` where it ended because of its memory.

What atheris instruments loses the outcome of every comparison of a numpy array (atheris 3.0.0: 39 kB for each
`array == 7` of 40,000 bytes, none without it), so that `frames` grows by 40 kB an input. Whoever started a worker that
was full starts another one in the same FOLDER, which goes on from the corpus that is there.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import sys
import time
import warnings
from pathlib import Path

import atheris

from tests.fuzz.harness import MEMORY_LIMIT_BYTES, Harness, timed

_TELL_EVERY_S = 0.5
_MOST_RESIDENT_BYTES, _LOOK_EVERY = 400 << 20, 200
_DEAD_AFTER_S = 20
"""libFuzzer's own limit, of wall time, for what hangs outside of Python; the harness measures processor time."""


class Told:
    """What a worker has done so far, written where its parent finds it also after it has died."""

    def __init__(self, path: Path, expected: int) -> None:
        self._path = path
        self._expected = expected
        self._begun = self._written = time.monotonic()
        self._inputs = 0
        self._slowest_s = 0.0

    def count(self, took_s: float) -> None:
        """Count an input."""
        self._inputs += 1
        self._slowest_s = max(self._slowest_s, took_s)
        if self._inputs == self._expected or time.monotonic() - self._written > _TELL_EVERY_S:
            self.write()

    def end_where_full(self) -> None:
        """End the process where it has grown too large; looked at every so often."""
        if self._inputs % _LOOK_EVERY == 0 and _resident_bytes() > _MOST_RESIDENT_BYTES:
            self.write(full=True)
            os._exit(0)  # libFuzzer takes every other end for a crash

    def write(self, *, full: bool = False) -> None:
        """Write it down."""
        self._written = time.monotonic()
        seconds = self._written - self._begun
        told = {"inputs": self._inputs, "seconds": seconds, "slowest_s": self._slowest_s, "full": full}
        self._path.write_text(json.dumps(told))


def _resident_bytes() -> int:
    """What of this process is in memory; at most so far, where the system does not say what is now."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        return int(statm.read_text().split()[1]) * resource.getpagesize()
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> None:
    name, inputs, seconds, folder = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    warnings.simplefilter("error")
    with atheris.instrument_imports(include=["benchctl", "benchctl_instruments", "tomllib"]):
        from tests.fuzz.harness import harness

        one = harness(name)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    told = Told(folder / "told.json", inputs)
    told.write()

    def take(data: bytes) -> None:
        took_s = float("nan")
        with contextlib.ExitStack() as stack:
            stack.callback(lambda: told.count(took_s if took_s == took_s else 0.0))
            took_s = timed(one, data)
        told.end_where_full()

    atheris.Setup([sys.argv[0], *_options(one, inputs, seconds, folder)], take)
    atheris.Fuzz()


def _options(one: Harness, inputs: int, seconds: int, folder: Path) -> list[str]:
    corpus = folder / "corpus"
    corpus.mkdir(exist_ok=True)  # it is there where a worker that was full has begun it
    for number, data in enumerate(one.inputs()):
        (corpus / f"seed-{number}").write_bytes(data)
    tokens = folder / "tokens.dict"
    tokens.write_text("".join(f'"{_escaped(token)}"\n' for token in one.tokens or (b"\0",)))  # not empty
    return [
        str(corpus),
        f"-runs={inputs}",
        f"-max_total_time={seconds}",
        f"-max_len={one.longest}",
        f"-timeout={_DEAD_AFTER_S}",
        f"-artifact_prefix={folder}/",
        f"-dict={tokens}",
        "-verbosity=0",
    ]


def _escaped(token: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in token)


if __name__ == "__main__":
    main()
