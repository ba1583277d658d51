"""Starts a module of ours as a process of its own, which finds what this one finds and hears no signal meant for it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence

from benchctl.processors import set_free

if sys.platform == "win32":  # neither Ctrl-C nor the console's end reaches it; elsewhere it has a session of its own
    _OF_ITS_OWN = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
else:
    _OF_ITS_OWN = 0


def own_process(module: str, arguments: Sequence[str] = (), *, stderr: int | None = None) -> subprocess.Popen[bytes]:
    """`python -m MODULE ARGUMENTS`, with pipes without buffers to and from it. Not tried on Windows.

    `stderr` is as of `subprocess.Popen`. Raises `OSError` where the system has no room for another process.
    """
    process = subprocess.Popen(  # noqa: S603 - this Python, a module of ours
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=stderr,
        bufsize=0,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
        creationflags=_OF_ITS_OWN,
    )
    set_free(process.pid)
    return process
