"""The journal of a campaign: one JSON object a line, in the order in which things happened.

A crash may leave its last line torn. Whoever reads takes the lines that are whole; whoever goes on writing first makes
an event of the torn one, so that every line is JSON again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchctl.atomic import disk_errors, sync_file, whole_file
from benchctl.recordings.model import Status

Events = Sequence[dict[str, Any]]

ENDED: tuple[Status, ...] = ("complete", "interrupted", "aborted")


def append_event(path: Path, kind: str, data: dict[str, Any]) -> None:
    """Append a line: `kind`, wall time (UTC) and `data` (plain JSON); it survives `kill -9`."""
    with disk_errors(path), path.open("a", encoding="utf-8") as file:
        file.write(f"{_line(kind, data)}\n")


def sync_journal(path: Path) -> None:
    """Wait until every line is on the disk."""
    with disk_errors(path):
        sync_file(path)


def journal_text(path: Path) -> str:
    """The journal as it stands; empty where there is none yet."""
    return path.read_bytes().decode("utf-8", errors="replace") if path.exists() else ""


def events_in(text: str) -> list[dict[str, Any]]:
    """The events of a journal; lines that are no JSON object are passed over."""
    found = (_event(line) for line in text.split("\n"))
    return [event for event in found if event is not None]


def mend_journal(path: Path) -> None:
    """Let every line be whole; one that a crash tore becomes an event of kind `torn` that holds its text."""
    text = journal_text(path)
    lines = text.removesuffix("\n").split("\n") if text else []
    mended = [line if _event(line) is not None else _line("torn", {"text": line}) for line in lines]
    whole = "".join(f"{line}\n" for line in mended)
    if whole != text or not path.exists():
        with whole_file(path) as temporary:
            temporary.write_text(whole, encoding="utf-8", newline="\n")


def last_word(events: Events) -> tuple[Status, str]:
    """How a campaign ended whose program is gone, and why: as that said itself, else `aborted`."""
    heard = [event for event in events if event.get("kind") != "guard"]  # written after the program had died
    for event in reversed(heard):
        if event.get("kind") in ("resume", "step"):
            break
        if event.get("kind") in ("safe", "finish", "recover") and event.get("status") in ENDED:
            return event["status"], str(event.get("reason", ""))
    when = f"last heard of at {heard[-1].get('wall_time', 'an unknown time')}" if heard else "before anything happened"
    return "aborted", f"its program died, {when}"


def _line(kind: str, data: dict[str, Any]) -> str:
    return json.dumps({"kind": kind, "wall_time": datetime.now(UTC).isoformat(), **data}, ensure_ascii=False)


def _event(line: str) -> dict[str, Any] | None:
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) else None
