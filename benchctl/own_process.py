"""Run a module of this package in a separate process with the same import path, isolated from signals to this process.

A damaged or hostile file may crash the library in C that decodes it, keep it busy for ever, or make it allocate
gigabytes. Such a file is opened in a process with limits, which `run_limited` starts and which calls `limit_itself`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

from benchctl.processors import set_free

if sys.platform == "win32":  # isolates it from Ctrl-C and the console's end; elsewhere a new session does
    _OF_ITS_OWN = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
else:
    import resource

    _OF_ITS_OWN = 0

_SLOWER = 20
"""Allowed ratio of wall time to processor time, for a busy machine."""


def own_process(
    module: str,
    arguments: Sequence[str] = (),
    *,
    stdout: int | IO[bytes] = subprocess.PIPE,
    stderr: int | None = None,
    pass_fds: Sequence[int] = (),
) -> subprocess.Popen[bytes]:
    """Start `python -m MODULE ARGUMENTS` with unbuffered pipes for stdin and stdout. Not tried on Windows.

    `stdout`, `stderr` and `pass_fds` are as for `subprocess.Popen`. Raises `OSError` if the system cannot start another
    process.
    """
    process = subprocess.Popen(  # noqa: S603 - this Python, a module of ours
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=stdout,
        stderr=stderr,
        bufsize=0,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
        pass_fds=pass_fds,
        creationflags=_OF_ITS_OWN,
    )
    set_free(process.pid)
    return process


def run_limited(
    module: str, arguments: Sequence[str], limit_s: float, *, pass_fds: Sequence[int] = ()
) -> tuple[int, bytes]:
    """Run a module that calls `limit_itself(limit_s, …)`; return its exit status, negative for a signal, and stdout.

    The process is killed if it takes far longer than `limit_s` by the wall clock, such as when it waits for the disk.
    """
    child = own_process(module, arguments, stderr=subprocess.DEVNULL, pass_fds=pass_fds)
    try:
        written = child.communicate(timeout=_SLOWER * limit_s)[0]
    except subprocess.TimeoutExpired:
        child.kill()
        written = child.communicate()[0]
    return child.returncode, written


def limit_itself(limit_s: float, most_bytes: int) -> None:
    """Limit this process to `limit_s` of additional processor time and `most_bytes` of additional memory.

    Memory is limited on Linux only, where the size of the process is known; Windows has no such limits.
    """
    if sys.platform == "win32":
        return
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    seconds = round(sum(resource.getrusage(resource.RUSAGE_SELF)[:2]) + limit_s)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    with suppress(OSError):
        most_bytes += int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))


def peak_bytes() -> int:
    """Return the peak memory of this process in bytes; 0 on Windows.

    On Linux, a child's `ru_maxrss` includes the memory of its parent, but its VmHWM does not.
    """
    if sys.platform == "win32":
        return 0
    with suppress(OSError):
        fields = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
        return int(fields["VmHWM"].split()[0]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
