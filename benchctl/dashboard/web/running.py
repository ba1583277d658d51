"""The live page from a folder to its end: what `benchctl serve` does."""

from __future__ import annotations

import importlib
import ipaddress
import threading
from collections.abc import Callable
from pathlib import Path

import benchctl
from benchctl.campaign.stop import stop_on_signals
from benchctl.confined import confine
from benchctl.dashboard.data.catalogue import Catalogue
from benchctl.dashboard.data.places import cache_folder
from benchctl.dashboard.data.series import SeriesReader
from benchctl.dashboard.web.app import page_app
from benchctl.dashboard.web.own_address import is_loopback, own_names
from benchctl.dashboard.web.server import listening, lower_priority, serve_until
from benchctl.dashboard.web.site import Explain, Site
from benchctl.dashboard.web.tokens import Tokens


def run_page(
    root: Path,
    host: str,
    port: int,
    *,
    read_only: bool,
    explain: Explain,
    ready: Callable[[str, str, str], None],
    warn: Callable[[str], None],
) -> None:
    """Serve the campaigns below `root` until Ctrl-C or SIGTERM.

    `ready` is told the address, the token and the one that only looks, once requests are answered; `warn` is told
    beforehand what a person should know.
    The process opens no files outside `root` from then on (`benchctl.confined`).
    Raises `UsageError` where the port cannot be had.
    """
    lower_priority()  # of this thread and of all that it begins
    root, cache, tokens = root.resolve(), cache_folder(), Tokens(read_only=read_only)
    confine(root, cache, Path(benchctl.__file__).parent)
    with stop_on_signals() as stop, listening(host, port) as sock, SeriesReader(cache) as series:
        bound_port = sock.getsockname()[1]
        if not is_loopback(host):
            warn(
                f"--host {host}: the link is not encrypted, others can read on it, tokens too; safer: leave --host out "
                f"and, from the other machine, ssh -L {bound_port}:127.0.0.1:{bound_port} to this one"
            )
        site = Site(
            root=root,
            cache=cache,
            tokens=tokens,
            cookie=f"benchctl_{bound_port}",
            explain=explain,
            catalogue=Catalogue(root, cache),
            series=series,
        )

        def tell_ready() -> None:
            ready(_url(host, bound_port), tokens.token, tokens.view_token)
            threading.Thread(target=_warm_up, daemon=True).start()

        serve_until(stop, page_app(site, own_names(host)), sock, tell_ready)


def _warm_up() -> None:
    """Import, while nobody waits for it, what the first look at a run needs: it takes seconds."""
    importlib.import_module("benchctl.campaign.provenance")


def _url(host: str, port: int) -> str:
    """The address by which a browser on this machine finds the page."""
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return f"http://{host}:{port}/"
    if address.is_unspecified:
        return f"http://127.0.0.1:{port}/" if address.version == 4 else f"http://[::1]:{port}/"
    return f"http://{address}:{port}/" if address.version == 4 else f"http://[{address}]:{port}/"
