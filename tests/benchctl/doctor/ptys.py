"""Pseudo-terminals as ports, and other processes that have them open, or may not."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_HOLD = "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('held', flush=True); sys.stdin.read()"


@contextmanager
def terminal() -> Iterator[str]:
    """The name of a new pseudo-terminal."""
    master, slave = os.openpty()
    try:
        yield os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


@contextmanager
def held(device: str) -> Iterator[int]:
    """Another process that has a device open; its number."""
    with subprocess.Popen(
        [sys.executable, "-c", _HOLD, device], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        try:
            yield process.pid
        finally:
            process.kill()
