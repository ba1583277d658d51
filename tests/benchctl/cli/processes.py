"""benchctl as its users run it: a process of its own, its streams read, its exit status looked at."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def benchctl(*arguments: str | Path, timeout_s: float = 50.0) -> subprocess.CompletedProcess[str]:
    """Run a verb to its end."""
    return subprocess.run(
        [sys.executable, "-m", "benchctl", *map(str, arguments)], capture_output=True, text=True, timeout=timeout_s
    )


@contextmanager
def started(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """Start a verb; it is killed where the block has not ended it."""
    with subprocess.Popen(
        [sys.executable, "-m", "benchctl", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def simulated_servers(bench_toml: Path, *arguments: str) -> Iterator[dict[str, str]]:
    """`benchctl sim` as a process; yields the addresses that it prints, and `bench_toml` reaches it."""
    with started("sim", "--bench", "simulated", "--write-bench", bench_toml, *arguments) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        yield json.loads(line)
        process.terminate()
        process.wait(timeout=10)
        assert process.returncode == 0
