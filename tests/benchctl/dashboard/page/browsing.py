"""A browser before `benchctl serve`: pages that tell what went wrong in them, and pictures of them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, Request, expect, sync_playwright

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
_PATIENCE_MS = 20_000
"""For what should be there at once: on a machine with much else to do it is not."""
DESK, TELEPHONE = (1280, 800), (390, 844)
PICTURES = "BENCHCTL_SCREENSHOTS"
"""The folder, named by this environment variable, into which tests put pictures of what they saw."""


@dataclass(frozen=True)
class Served:
    """A running server: its process, its address and its tokens."""

    process: subprocess.Popen[str]
    url: str
    token: str
    view_token: str
    release_token: str


@dataclass
class Seen:
    """What a page said and asked for while it was looked at."""

    page: Page
    problems: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    forgiven: tuple[str, ...] = ()

    def complaints(self) -> list[str]:
        """Everything that should not have happened, but for what contains one of the forgiven texts."""
        return [one for one in self.problems + self.foreign if not any(forgiven in one for forgiven in self.forgiven)]


def browser_path() -> str:
    """A browser of this machine, or the test is skipped."""
    fixed = Path("/usr/bin/chromium")
    found = str(fixed) if fixed.exists() else next(filter(None, map(shutil.which, _BROWSERS)), "")
    if not found:
        pytest.skip(f"no browser is installed: looked for {', '.join(_BROWSERS)}")
    return found


@contextmanager
def a_browser() -> Iterator[Browser]:
    """Chromium without a window."""
    path = browser_path()
    expect.set_options(timeout=_PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=_ARGUMENTS)
        yield browser
        browser.close()


@contextmanager
def serving(folder: Path, cache: Path, *arguments: str, port: int = 0) -> Iterator[Served]:
    """`benchctl serve` on a folder; ended with the block where it has not ended before."""
    command = [sys.executable, "-m", "benchctl", "serve", str(folder), "--port", str(port), *arguments]
    environment = {**os.environ, "BENCHCTL_CACHE": str(cache)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            line = process.stdout.readline()
            assert line, process.stderr.read()
            yield Served(process=process, **json.loads(line))
        finally:
            process.terminate()
            process.wait(timeout=20)


@contextmanager
def a_page(
    browser: Browser, url: str, size: tuple[int, int] = DESK, *, dark: bool = False, still: bool = False
) -> Iterator[Seen]:
    """An empty page in a session of its own; whoever leaves it has asked nobody but `url` and heard no complaint."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme="dark" if dark else "light",
        has_touch=size == TELEPHONE,
        reduced_motion="reduce" if still else "no-preference",
        timezone_id="Europe/Berlin",
        locale="en-GB",
    )
    page = context.new_page()
    page.set_default_timeout(_PATIENCE_MS)
    seen = Seen(page)
    ours = urlsplit(url).netloc

    def heard(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            seen.problems.append(f"console: {message.text} ({message.location.get('url', '')})")

    def asked(request: Request) -> None:
        parts = urlsplit(request.url)
        if parts.scheme not in ("data", "blob") and parts.netloc != ours:
            seen.foreign.append(f"asked somebody else: {request.url}")

    page.on("console", heard)
    page.on("pageerror", lambda error: seen.problems.append(f"error: {error}"))
    context.on("request", asked)
    try:
        yield seen
        assert not seen.complaints(), seen.complaints()
    finally:
        context.close()


def picture(page: Page, name: str, *, whole: bool = False) -> None:
    """Keep a picture of a page where a folder for them is given."""
    folder = os.environ.get(PICTURES)
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=Path(folder) / f"{name}.png", full_page=whole)


def sideways(page: Page) -> int:
    """By how many pixels a page is wider than its window."""
    found: int = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
    return found
