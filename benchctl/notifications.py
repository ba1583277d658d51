"""Messages by mail or chat: the table `[notify]` of bench.toml, and sending by the library apprise.

The URLs contain passwords and tokens. They are masked wherever they are shown (`tgram://…`), and the text of bench.toml
that recordings store has masked URLs, those in comments included.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Literal, get_args
from urllib.parse import unquote

from pydantic import Field, SecretStr, model_validator

from benchctl.tables import Table
from benchctl_instruments.errors import LinkError, UsageError, in_line

Event = Literal["done", "result", "stopped", "fault", "hold", "guard", "certificate"]
"""What a message reports: `done`, `stopped` and `fault` are the ends of a run, `result` is the error of its fit or its
verdict, `hold` a wait for an interlock or an operator, `guard` an action of the guard, and `certificate` one that
expires."""

_ENV = "env:"
_PLACE = r"^(env:[A-Za-z_][A-Za-z0-9_]*|[A-Za-z][A-Za-z0-9+.-]*://\S+)$"
_IN_COMMENT = re.compile(r"#.*")
_URL = re.compile(r"""\b(?!(?:tcp|serial|socket)://)([A-Za-z][\w+.-]*://)[^\s"',\]]+""")
"""A URL, other than the address of an instrument."""
_MASKED_WORDS = re.compile(r"…(?:[\W_]?…)+")


class Notify(Table):
    """Where messages are sent, and about which events."""

    urls: tuple[Annotated[SecretStr, Field(json_schema_extra={"pattern": _PLACE})], ...] = Field(
        min_length=1,
        title="Recipients",
        description="URLs of the library Apprise; env:NAME takes one from an environment variable."
        " Recordings store no passwords or tokens of them.",
        examples=[["mailto://user:password@example.org", "env:BENCH_CHAT"]],
    )
    on: tuple[Event, ...] = Field(
        default=get_args(Event), title="Events", description="What is reported; by default everything."
    )

    @model_validator(mode="before")
    @classmethod
    def _not_shown(cls, given: Any) -> Any:
        """Refuse other types here, because pydantic's own message would show the value."""
        if not isinstance(given, dict):
            raise ValueError("expected one table, [notify]")
        urls = given.get("urls", [])
        if not isinstance(urls, list | tuple):
            raise ValueError("urls: expected a list of texts")
        for number, url in enumerate(urls, 1):
            text = url.get_secret_value() if isinstance(url, SecretStr) else url
            if not isinstance(text, str) or not re.match(_PLACE, text):
                raise ValueError(f"urls: expected URLs (scheme://…) or env:NAME, number {number} is neither")
        return given


def urls_of(notify: Notify | None) -> list[str]:
    """Return the URLs with their secrets; none without `[notify]`."""
    return [url.get_secret_value() for url in notify.urls] if notify else []


def masked(url: str) -> str:
    """Return a URL for display: its scheme only; a reference to an environment variable is not changed.

    >>> masked("mailto://user:password@example.org"), masked("env:BENCH_CHAT")
    ('mailto://…', 'env:BENCH_CHAT')
    """
    return url if url.startswith(_ENV) else f"{url.partition('://')[0]}://…"


def without_secrets(text: str, notify: Notify | None) -> str:
    """Return the text of a bench.toml with masked URLs, on the same lines.

    Raises
    ------
    UsageError
        If a URL is written with escapes, so that it is not found in the text.
    """
    urls = urls_of(notify)
    for url in urls:
        if url not in text:
            raise UsageError(
                f"notify.urls: {masked(url)} is written with escapes; expected plain text, so that recordings can "
                "leave its secrets out"
            )
    for url in sorted(urls, key=len, reverse=True):  # one may be the beginning of another
        text = text.replace(url, masked(url))
    return _IN_COMMENT.sub(lambda comment: _URL.sub(r"\1…", comment[0]), text)


class Recipient:
    """Somebody who gets messages, by a URL of `[notify]`; `shown` is its masked URL.

    Raises `UsageError` if apprise is not installed or does not know the URL, or the environment variable is not set.
    """

    def __init__(self, url: str) -> None:
        self.shown = masked(url)
        self._url = self._resolved(url)
        try:
            import apprise
        except ImportError as err:
            raise UsageError("[notify] needs apprise, which is not installed; pip install 'benchctl[notify]'") from err
        asset = apprise.AppriseAsset(app_id="benchctl", storage_mode=apprise.PersistentStoreMode.MEMORY)
        with _warnings_of_apprise() as log:
            service = apprise.Apprise.instantiate(self._url, asset=asset)
        if not isinstance(service, apprise.NotifyBase):
            raise UsageError(f"notify.urls: {self.shown} is no URL that apprise can use: {self._reason(log)}")
        self._service = service

    def send(self, title: str, body: str) -> None:
        """Send a message and wait for the answer; raise `LinkError` if it was not delivered."""
        with _warnings_of_apprise() as log:
            try:
                delivered = self._service.notify(title=title, body=body)
            except Exception as err:  # any error of a service: a message must not end a run
                delivered = False
                log.append(f"{type(err).__name__}: {err}")
        if not delivered:
            raise LinkError(f"no message to {self.shown}: {self._reason(log)}; benchctl notify --test tries it again")

    def _resolved(self, url: str) -> str:
        if not url.startswith(_ENV):
            return url
        name = url.removeprefix(_ENV)
        if not (found := os.environ.get(name)):
            raise UsageError(f"notify.urls: {url}: needs the environment variable {name}, which is not set")
        return found

    def _reason(self, log: list[str]) -> str:
        """Return apprise's explanation in one line, without any word of the URL."""
        secret = self._url.partition("://")[2]
        words = set(re.findall(r"\w+", f"{secret} {unquote(secret)}"))
        text = re.sub(r"\w+", lambda word: "…" if word[0] in words else word[0], in_line("; ".join(log)))
        return _MASKED_WORDS.sub("…", text) or "no reason stated"


@contextmanager
def _warnings_of_apprise() -> Iterator[list[str]]:
    """Collect what apprise logs, which otherwise appears on stderr, with parts of the URL."""
    log: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: log.append(record.getMessage())  # type: ignore[method-assign]
    logger = logging.getLogger("apprise")
    logger.addHandler(handler)
    try:
        yield log
    finally:
        logger.removeHandler(handler)
