"""The console script; prints each error as one line and returns the exit status."""

from __future__ import annotations

import io
import os
import sys

from benchctl.cli.messages import tell
from benchctl.cli.verbs import SYNONYMS, VERBS, overview
from benchctl_instruments.errors import BenchError, UsageError

_STOPPED = 130
"""The exit status of a program that SIGINT ended."""
_KEEP_MEMORY = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(1 << 62), "MALLOC_ARENA_MAX": "1"}
"""Settings by which the GNU C library keeps freed memory for later large arrays, in one heap for all threads.

By default it returns every array above 32 MB to the system, which clears the pages again at the next allocation. This
takes more than a quarter of the processor time of a diagnosis of ten million rows.
"""


def main() -> None:
    """Run the console script."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # characters the terminal cannot show are escaped
            stream.reconfigure(errors="backslashreplace")
    if sys.argv[1:2] == ["diagnose"]:
        _keep_memory()
    if "_BENCHCTL_COMPLETE" in os.environ:
        from benchctl.cli.completing import complete

        sys.exit(complete(os.environ["_BENCHCTL_COMPLETE"], sys.argv[1:]))
    sys.exit(run_verb(sys.argv[1:]))


def _keep_memory() -> None:
    """Restart this program with `_KEEP_MEMORY` set, since the C library reads it only at program start."""
    if not sys.platform.startswith("linux"):
        return
    if any(name not in os.environ for name in _KEEP_MEMORY):
        # S606: this very program, without a shell
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**_KEEP_MEMORY, **os.environ})  # noqa: S606
    for name in _KEEP_MEMORY:  # child processes do not inherit it
        del os.environ[name]


def run_verb(arguments: list[str]) -> int:
    """Run a verb and return its exit status: 0 to 3 (see `benchctl_instruments.errors`), or 130 after Ctrl-C."""
    try:
        for argument in arguments:
            if any("\ud800" <= character <= "\udfff" for character in argument):
                raise UsageError(f"{argument!a}: expected a name in UTF-8; rename it")
        if arguments and arguments[0] in VERBS:
            from benchctl.cli.command import run_command

            status = run_command(arguments[0], arguments[1:])
        else:
            status = _without_verb(arguments)
    except BenchError as err:
        tell(f"benchctl: {' '.join(str(err).split())}", err=True)
        return err.exit_status
    except KeyboardInterrupt:
        status = _STOPPED
    if status == _STOPPED:
        tell("benchctl: stopped", err=True)
    return status


def _without_verb(arguments: list[str]) -> int:
    """Run benchctl with an option or nothing in place of a verb; return the exit status."""
    match arguments:
        case []:
            tell(overview(), err=True)
            return 2
        case ["-h" | "--help", *_]:
            tell(overview())
        case ["--version", *_]:
            import benchctl

            tell(f"benchctl {benchctl.__version__}")
        case ["--install-completion" | "--show-completion" as option, *shell]:
            from benchctl.cli.completing import install, script

            tell((install if option == "--install-completion" else script)(*shell[:1]))
        case [unknown, *_]:
            raise UsageError(_unknown(unknown))
    return 0


def _unknown(name: str) -> str:
    from benchctl.closeness import meant

    if name.startswith("-"):
        options = ("--help", "--version", "--install-completion", "--show-completion")
        hint = meant(name, options, "a verb comes first and its options after it: benchctl run --help")
        return f"there is no option {name} before a verb: {hint}"
    if name in SYNONYMS:
        return f"there is no verb {name}: did you mean {SYNONYMS[name]}?"
    return f"there is no verb {name}: {meant(name, VERBS, 'benchctl --help lists them')}"
