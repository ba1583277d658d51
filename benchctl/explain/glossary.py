"""`terms/*.toml`: the terms of the field in words, and what registry and catalogue leave to say of their own."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.resources import files
from typing import Any, get_args

from benchctl.explain.entry import Entry, Group


@cache
def tables() -> Mapping[str, Any]:
    """All files as one; a table that several of them have is shared out over them."""
    found: dict[str, Any] = {}
    for file in files("benchctl.explain").joinpath("terms").iterdir():
        for name, table in tomllib.loads(file.read_text(encoding="utf-8")).items():
            found[name] = found.get(name, {}) | table
    return found


def heading(group: Group) -> str:
    """What a group is called in the list."""
    return str(tables()["groups"][group])


def kind(group: Group) -> str:
    """What one entry of a group is."""
    return str(tables()["kinds"][group])


def beside(table: str, name: str) -> Mapping[str, Any]:
    """What they have to say of an effect or a metric beside its own description; empty where nothing."""
    found: Mapping[str, Any] = tables()[table].get(name, {})
    return found


def shared(table: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of an entry that every table may state."""
    return {name: tuple(table.get(name, ())) for name in ("sources", "see", "also")}


def term_entries() -> Iterator[Entry]:
    """The terms, in the order of their file within that of the groups."""
    for group in get_args(Group):
        for name, table in tables()["terms"].get(group, {}).items():
            yield Entry(
                name=name,
                title=name,
                group=group,
                words=table["words"],
                equation=table.get("equation", ""),
                drawing=table.get("picture", ""),
                **shared(table),
            )
