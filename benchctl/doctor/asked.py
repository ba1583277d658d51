"""What other programs of this machine say: run with a time limit, in plain English, and never required."""

from __future__ import annotations

import os
import shutil
import subprocess

_TIME_LIMIT_S = 5.0


def answer(*command: str) -> str | None:
    """What a program prints; None where it is not there, does not end in time, or fails without a word on stdout."""
    program = shutil.which(command[0])
    if program is None:
        return None
    try:
        ended = subprocess.run(  # noqa: S603 - the commands are ours
            [program, *command[1:]],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_TIME_LIMIT_S,
            env={**os.environ, "LC_ALL": "C", "SYSTEMD_PAGER": "", "SYSTEMD_COLORS": "0"},
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    text = ended.stdout.decode("utf-8", "replace").strip()
    return text if text or ended.returncode == 0 else None


def properties(text: str | None) -> dict[str, str]:
    """Lines `NAME=VALUE` as a mapping."""
    pairs = (line.partition("=") for line in (text or "").splitlines())
    return {name.strip(): value.strip() for name, equals, value in pairs if equals}
