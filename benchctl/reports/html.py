"""Rendering of reports as self-contained HTML files from the templates and the style sheet of this package."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from benchctl.atomic import whole_file
from benchctl.reports import text
from benchctl.reports.figures import Drawing, embedded


def render(template: str, **values: object) -> str:
    """Render a template of this package; text is escaped, only figures are inserted unescaped."""
    environment = Environment(
        loader=PackageLoader("benchctl.reports", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "percent": text.percent,
        "number": text.number,
        "plain": text.plain,
        "count": text.count,
        "svg": svg,
        "image": lambda png: Markup(embedded(png)),  # noqa: S704 - base64
    }
    style = Markup(files("benchctl.reports").joinpath("report.css").read_text(encoding="utf-8"))  # noqa: S704 - ours
    return environment.get_template(template).render(style=style, **values)


def svg(drawing: Drawing) -> Markup:
    """Return the SVG of a figure; matplotlib escaped its labels."""
    return Markup(drawing.svg)  # noqa: S704 - drawn by us, escaped by matplotlib


def write_page(path: Path, page: str) -> None:
    """Write a page atomically; raises `UsageError` if it cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")
