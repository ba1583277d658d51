"""`benchctl help`: the pages of the handbook."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from benchctl.app.handbook import title_of, topics
from benchctl.cli.candidates import Candidate
from benchctl.cli.output import JsonOption, QuietOption, result_of


def _completed(incomplete: str) -> list[Candidate]:
    return [(topic, title_of(page)) for topic, page in topics().items() if topic.startswith(incomplete)]


def help(
    topic: Annotated[
        list[str] | None, typer.Argument(metavar="[TOPIC]", autocompletion=_completed, help="A topic of the handbook.")
    ] = None,
    json_to: JsonOption = None,
    quiet: QuietOption = False,
) -> None:
    """Show a page of the handbook; without a topic, list all pages.

    Example: `benchctl help first_campaign`, `benchctl help calibration`
    """
    from benchctl.closeness import meant
    from benchctl_instruments.errors import UsageError

    with result_of("help", json_to, quiet) as result:
        pages = topics()
        if not topic:
            result.values["topics"] = [{"topic": name, "title": title_of(page)} for name, page in pages.items()]
            width = max(map(len, pages))
            result.say("\n".join(f"{name:<{width}}  {title_of(page)}" for name, page in pages.items()))
            return
        name = "_".join(topic).replace("-", "_").lower()
        if name not in pages:
            raise UsageError(f"help {' '.join(topic)}: there is no such topic: {meant(name, pages)}")
        result.values |= {"topic": name, "title": title_of(pages[name]), "page": pages[name]}
        result.say(_rendered(pages[name]))


def _rendered(page: str) -> str:
    """Return the page as it is, or laid out for a terminal."""
    if not sys.stdout.isatty():
        return page.rstrip("\n")
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console()
    with console.capture() as captured:
        console.print(Markdown(page, hyperlinks=False))
    return captured.get().rstrip("\n")
