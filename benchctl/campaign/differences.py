"""What differs between two runs of one procedure, as their recordings tell it, in groups."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from benchctl.campaign.changes import changed, changes, flat
from benchctl.campaign.provenance import table_of
from benchctl.documents import toml_document
from benchctl.limits import cut
from benchctl.recordings.model import Meta
from benchctl_instruments.errors import UsageError

_MOST_LINES = 20
_MOST_COMPARED = 2000
"""Lines of a text; the time that a comparison takes grows with their square."""
_CONTEXT = 1
_LONGEST_LINE = 200
_OBEYED = ("physics", "effects")


@dataclass(frozen=True, slots=True, kw_only=True)
class Differences:
    """Sentences, and lines of unified diffs, of each group; empty where nothing differs."""

    procedure: tuple[str, ...]
    parameters: tuple[str, ...]
    bench: tuple[str, ...]
    instruments: tuple[str, ...]
    software: tuple[str, ...]
    operator: tuple[str, ...]


def differences(first: Meta, again: Meta, *, expected: Collection[str] = ()) -> Differences:
    """What differs from the first run to the one again.

    `expected` are dotted names of what a simulated bench obeys that are not said: whoever ran it again chose them.
    Raises `UsageError` where the provenance of one is damaged.
    """
    both = (first, again)
    reached = [{"reached": meta.provenance.get("instruments_reached", "")} for meta in both]
    instruments = [_table(meta, "instruments") | how for meta, how in zip(both, reached, strict=True)]
    before, now = first.provenance, again.provenance
    return Differences(
        procedure=tuple(_of_procedure(before, now)),
        parameters=tuple(changes("", _table(first, "parameters"), _table(again, "parameters"))),
        bench=tuple(_of_bench(first, again, expected)),
        instruments=tuple(changes("", *instruments)),
        software=tuple(changes("", _table(first, "software"), _table(again, "software"))),
        operator=tuple(changes("", _only(before, "operator"), _only(now, "operator"))),
    )


def _of_procedure(before: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    yield from changes("", _only(before, "procedure"), _only(now, "procedure"))
    digests = [told.get("procedure_sha256", "")[:12] or None for told in (before, now)]
    if digests[0] != digests[1]:
        yield changed("its source (SHA-256)", *digests)
        yield from _diff(before.get("procedure_source", ""), now.get("procedure_source", ""))


def _of_bench(first: Meta, again: Meta, expected: Collection[str]) -> Iterator[str]:
    before, now = first.provenance, again.provenance
    for name in ("bench_toml", "chamber_profile"):
        yield from _diff(before.get(name, ""), now.get(name, ""))
    yield from _of_obeyed(first, again, expected)


def _of_obeyed(first: Meta, again: Meta, expected: Collection[str]) -> Iterator[str]:
    """What the two simulated benches obeyed that their files do not say, as a seed."""
    obeyed = [flat({name: _table(meta, f"bench_{name}") for name in _OBEYED}) for meta in (first, again)]
    said = [_said(meta) for meta in (first, again)]
    beside = {
        name
        for table, text in zip(obeyed, said, strict=True)
        for name in table.keys() | text.keys()
        if table.get(name) != text.get(name)
    }
    before, now = ({name: table.get(name) for name in beside - set(expected)} for table in obeyed)
    yield from changes("", before, now)


def _said(meta: Meta) -> dict[str, Any]:
    """The same tables by the bench.toml; nothing where they were not obeyed, or it cannot be read."""
    if not meta.provenance.get("bench_physics"):
        return {}
    try:
        tables = toml_document(meta.provenance.get("bench_toml", ""), "bench.toml")
    except UsageError:
        return {}
    return flat({name: tables.get(name, {}) for name in _OBEYED})


def _diff(before: str, now: str) -> Iterator[str]:
    """A short unified diff without its heading; nothing where the texts are the same."""
    if before == now:
        return
    lines = before.splitlines(), now.splitlines()
    if max(map(len, lines)) > _MOST_COMPARED:
        yield f"differs, and is too long to be compared: {len(lines[0])} lines, and {len(lines[1])}"
        return
    found = list(difflib.unified_diff(*lines, n=_CONTEXT, lineterm=""))[2:]
    yield from (cut(line, _LONGEST_LINE) for line in found[:_MOST_LINES])
    if len(found) > _MOST_LINES:
        yield f"… and {len(found) - _MOST_LINES} more lines"
    if not found:
        yield "differs in the ends of its lines only"


def _table(meta: Meta, name: str) -> dict[str, Any]:
    return flat(table_of(meta, name, "the first run"))


def _only(told: Mapping[str, str], name: str) -> dict[str, str]:
    """That entry alone, where it says anything."""
    return {name: told[name]} if told.get(name) else {}
