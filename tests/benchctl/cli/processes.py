"""benchctl as its users run it: a process of its own, its streams read, its exit status looked at."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from benchctl.campaign.reserved import lock_files, make_lock_folder
from benchctl.cli.app import run_verb
from benchctl.locks import held

Ran = subprocess.CompletedProcess[str]


def benchctl(*arguments: str | Path, timeout_s: float = 150.0) -> Ran:
    """Run a verb to its end; the time-out is for hangs, not for what others do to a shared machine."""
    return subprocess.run(
        [sys.executable, "-m", "benchctl", *map(str, arguments)], capture_output=True, text=True, timeout=timeout_s
    )


def without_a_process(*arguments: str | Path, folder: Path | None = None) -> Ran:
    """Run a verb in this process, in `folder`, nobody at a terminal: what a process of its own says, in less time.

    For what is said of files; that each verb is a program, and ends as one, other tests of it show.
    """
    with (
        open(os.devnull, encoding="utf-8") as nobody,
        pytest.MonkeyPatch.context() as patched,
        chdir(folder or Path.cwd()),
        redirect_stdout(StringIO()) as out,
        redirect_stderr(StringIO()) as err,
    ):
        patched.setattr(sys, "stdin", nobody)
        status = run_verb(list(map(str, arguments)))
    return Ran(arguments, status, out.getvalue(), err.getvalue())


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
    """`benchctl sim` as a process; yields the addresses that it prints, and `bench_toml` reaches it.

    A run that an earlier test killed may have left its lock at a port that is now given out again: it is not of these
    instruments, whose stream the next run would end.
    """
    with started("sim", "--bench", "simulated", "--write-bench", bench_toml, *arguments) as process:
        assert process.stdout is not None
        addresses = json.loads(process.stdout.readline())
        make_lock_folder()
        with held({lock for one in addresses.values() for lock in lock_files(one)}, "a simulated bench", "a test"):
            pass  # what is released was abandoned by nobody
        yield addresses
        process.terminate()
        process.wait(timeout=50)
        assert process.returncode == 0
