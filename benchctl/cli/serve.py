"""`benchctl serve`: serve the live page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from benchctl.cli.messages import tell
from benchctl.cli.output import bench_option

_EXTRA = frozenset({"fastapi", "starlette", "uvicorn", "websockets"})


def serve(
    folder: Annotated[Path, typer.Argument(help="A folder with campaigns anywhere in it.")] = Path("results"),
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="N", help="Where to listen; 0: any free port.")] = 0,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen on; default: this machine only.")
    ] = "127.0.0.1",
    bench: Annotated[str | None, bench_option("A bench.toml: what it releases can be started from the page.")] = None,
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Runs cannot be stopped or started from the page.")
    ] = False,
) -> None:
    """Show running and finished campaigns in a browser; a running campaign can be stopped from the page.

    With --bench, the procedures that the bench releases ([released.NAME]) can be checked and started from the page;
    such a run goes on if the server ends.

    Prints the address and three tokens as one line of JSON, then serves until Ctrl-C or SIGTERM. `view_token` permits
    viewing; `token` also starting, answering and stopping runs; `release_token` also signing acceptances with the key
    of [laboratory]. The server never changes a recording and runs at
    low priority, so that it does not disturb a run on the same machine. From another machine:
    `ssh -L 8123:127.0.0.1:8123 LAB-PC`, then open http://127.0.0.1:8123 there.

    Example: `benchctl serve`, `benchctl serve lab/results --port 8123 --read-only`,
    `benchctl serve lab/results --bench lab/bench.toml`
    """
    import json
    import os
    from contextlib import nullcontext

    from benchctl_instruments.errors import UsageError

    if not folder.is_dir():
        raise UsageError(f"{folder}: is not there, or is no folder; expected a folder with campaigns in it")
    try:
        from benchctl.dashboard.web.server import run_page
        from benchctl.dashboard.web.sessions import Tokens
    except ModuleNotFoundError as err:
        if err.name not in _EXTRA:
            raise
        raise UsageError(f'serve needs {err.name}, which is not installed; pip install "benchctl[dashboard]"') from err

    station = None
    if bench is not None and not read_only:
        from benchctl.app.station import Station

        station = Station(Path(bench), folder)

    def ready(url: str, tokens: Tokens) -> None:
        names = ("token", "view_token", "release_token")
        tell(json.dumps({"url": url} | {name: getattr(tokens, name) for name in names}))
        tell(f"open {url}#{tokens.token}", err=True)

    def warn(text: str) -> None:
        tell(f"benchctl: warning: {text}", err=True)

    def words(term: str) -> dict[str, Any]:
        from benchctl.explain.book import explained

        return explained(term)

    def glossary() -> str:
        from benchctl.explain.glossary_page import glossary_page

        return glossary_page()

    with station.reserved(f"benchctl serve {folder}") if station is not None else nullcontext():
        run_page(
            folder,
            host,
            port,
            read_only=read_only,
            station=station,
            explain=words,
            glossary=glossary,
            ready=ready,
            warn=warn,
        )
    # All output is written and everything is closed. A thread that is still reading a recording holds HDF5's lock, and
    # a normal exit of the interpreter would wait for it.
    os._exit(0)
