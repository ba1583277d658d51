"""The map file explained by example (`maps/*.toml`), as printed by `benchctl import --help`."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

_FILES = {
    "a table of samples": "samples",
    "a MATLAB file": "mat",
    "a database, or JSON": "records",
    "a table of static points": "points",
    "a table's drive, or a chamber": "drive",
}


def example(name: str) -> str:
    """Return the text of an example, by the name of its file."""
    return files("benchctl.recordings").joinpath("maps", f"{name}.toml").read_text(encoding="utf-8")


MAP_EXAMPLES: Mapping[str, str] = {title: example(name) for title, name in _FILES.items()}
"""Title -> map file."""
