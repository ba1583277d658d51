"""`benchctl serve`: the live page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from benchctl.cli.messages import tell

_EXTRA = frozenset({"fastapi", "starlette", "uvicorn", "websockets", "h11"})


def serve(
    folder: Annotated[Path, typer.Argument(help="A folder with campaigns anywhere in it.")] = Path("results"),
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="N", help="Where to listen; 0: any free port.")] = 0,
    host: Annotated[str, typer.Option(metavar="ADDRESS", help="Whom to answer: only this machine.")] = "127.0.0.1",
    read_only: Annotated[bool, typer.Option("--read-only", help="Nobody may stop a run from the page.")] = False,
) -> None:
    """Show campaigns in a browser: those that run, live, and those that are over; stop a run from there.

    Prints one line of JSON, its address and two tokens, then serves until Ctrl-C or SIGTERM. Whoever has `token` may
    stop a run, whoever has `view_token` only looks. It reads recordings and changes none, and gives way to a run on
    the same machine. From another machine: `ssh -L 8123:127.0.0.1:8123 LAB-PC`, then open http://127.0.0.1:8123 there.

    Example: `benchctl serve`, `benchctl serve lab/results --port 8123 --read-only`
    """
    import json
    import os

    from benchctl_instruments.errors import UsageError

    if not folder.is_dir():
        raise UsageError(f"{folder}: is not there, or is no folder; expected a folder with campaigns in it")
    try:
        from benchctl.dashboard.web.server import run_page
    except ModuleNotFoundError as err:
        if err.name not in _EXTRA:
            raise
        raise UsageError(f'serve needs {err.name}, which is not installed; pip install "benchctl[dashboard]"') from err

    def ready(url: str, token: str, view_token: str) -> None:
        tell(json.dumps({"url": url, "token": token, "view_token": view_token}))
        tell(f"open {url}#{token}", err=True)

    def warn(text: str) -> None:
        tell(f"benchctl: warning: {text}", err=True)

    def words(term: str) -> dict[str, Any]:
        from benchctl.explain.book import explained

        return explained(term)

    run_page(folder, host, port, read_only=read_only, explain=words, ready=ready, warn=warn)
    # All is said and closed. A thread that is still in the middle of a recording holds HDF5's lock, for which the
    # interpreter's own end would wait.
    os._exit(0)
