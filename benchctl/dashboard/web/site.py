"""The data of one server: its secrets, its campaigns, its threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from fastapi import Depends
from starlette.requests import HTTPConnection

from benchctl.app.station import Station
from benchctl.dashboard.data.catalogue import Catalogue
from benchctl.dashboard.data.series import SeriesReader
from benchctl.dashboard.web.answers import Readers, RefusalError
from benchctl.dashboard.web.rooms import Rooms
from benchctl.dashboard.web.sessions import Role, Sessions, Tokens

Explain = Callable[[str], dict[str, Any]]
"""A function that explains a term; raises `UsageError` for an unknown one."""
Glossary = Callable[[], str]
"""A function that returns the page of all terms, Markdown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Site:
    """The campaigns below `root`, for those who know the `tokens`; `cookie` is the name of a session's cookie.

    `station` starts released procedures, one job of `starting` after another, and signs, one job of `signing` after
    another. Quick reads have separate threads, so that they do not wait for long ones.
    """

    root: Path
    cache: Path
    tokens: Tokens
    cookie: str
    explain: Explain
    glossary: Glossary
    catalogue: Catalogue
    series: SeriesReader
    station: Station | None
    starting: Readers
    signing: Readers = field(default_factory=lambda: Readers("signing", threads=1, waiting=4, within_s=600.0))
    sessions: Sessions = field(default_factory=Sessions)
    rooms: Rooms = field(default_factory=Rooms)
    quick: Readers = field(default_factory=lambda: Readers("quick", threads=3, waiting=64))
    heavy: Readers = field(default_factory=lambda: Readers("heavy", threads=2, waiting=32))

    def may_start(self, role: Role) -> bool:
        """Return whether a role may start a run here."""
        return self.station is not None and role != "viewer"

    def may_sign(self, role: Role) -> bool:
        """Return whether a role may sign an acceptance here."""
        return self.station is not None and self.station.key is not None and role == "releaser"

    def path_of(self, key: str) -> Path:
        """Return a campaign's path; `RefusalError` 404 for an unknown id. Reads the disk."""
        path = self.catalogue.find(key)
        if path is None:
            raise RefusalError(404, f"there is no campaign {key}; ask for /api/campaigns again")
        return path


async def site_of(connection: HTTPConnection) -> Site:
    """Return the site that a request was sent to."""
    site: Site = connection.app.state.site
    return site


SiteOf = Annotated[Site, Depends(site_of)]
