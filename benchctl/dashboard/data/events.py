"""What happened in a campaign, in words: its journal, a stretch at a time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from benchctl.dashboard.data.event_words import told
from benchctl.dashboard.data.journal import Line, lines_after

MOST_EVENTS = 500


def events_after(path: Path, number: int) -> dict[str, Any]:
    """The events behind line `number` of a campaign's journal, at most 500, and the number to go on with (`next`).

    Raises `UsageError` where the campaign or its journal cannot be read.
    """
    events: list[dict[str, Any]] = []
    reached = number
    for line in lines_after(path, number):
        events += in_words([line])
        reached = line[0]
        if len(events) == MOST_EVENTS:
            break
    return {"events": events, "next": reached}


def in_words(lines: Iterable[Line]) -> list[dict[str, Any]]:
    """The events among some lines, each with its number, when it happened (UTC), its kind, its words and its level."""
    found = []
    for number, event in lines:
        says = told(event) if event is not None else None
        if event is not None and says is not None:
            found.append(
                {
                    "number": number,
                    "wall_time": str(event.get("wall_time", "")),
                    "kind": str(event.get("kind", "")),
                    "says": says[0],
                    "level": says[1],
                }
            )
    return found
