"""Run the processes of a trial: separate Python interpreters with one arithmetic thread, ended by a stop request."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from benchctl.campaign.stop import StopRequest

_LOOK_S = 0.2
_GRACE_S = 5.0
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class ProcessFailedError(Exception):
    """A process ended without an answer; the message states the reason in one line."""


def run_module(module: str, *arguments: str, stop: StopRequest, longest_s: float) -> str:
    """Return the output of `python -m module`.

    Raises
    ------
    ProcessFailedError
        If it fails, or takes longer than `longest_s`.
    StoppedError
        If a stop was requested; the process has then ended.
    """
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        # a separate session: Ctrl-C reaches only this program, which then ends the process
        process = subprocess.Popen(  # noqa: S603 - this Python, a module of ours
            [sys.executable, "-m", module, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env={**os.environ, **_ONE_THREAD},
            start_new_session=True,
        )
        try:
            _wait(process, stop, longest_s)
        finally:
            _end(process)
        out.seek(0)
        err.seek(0)
        if process.returncode:
            lines = err.read().strip().splitlines() or [f"exit status {process.returncode}"]
            raise ProcessFailedError(lines[-1])
        return out.read()


def _wait(process: subprocess.Popen[bytes], stop: StopRequest, longest_s: float) -> None:
    give_up_s = time.monotonic() + longest_s
    while process.poll() is None:
        stop.heed()
        if time.monotonic() > give_up_s:
            raise ProcessFailedError(f"no answer after {longest_s:g} s")
        time.sleep(_LOOK_S)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process that still runs: terminate it, and kill it if it does not end."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(_GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
