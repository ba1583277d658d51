"""The journal of a campaign: one JSON object per line, in the order of the events.

A crash may leave the last line incomplete. Readers use only complete lines; a writer, before it appends, converts the
incomplete line into an event, so that every line is JSON again. Folders may come from untrusted sources: a line that is
too long or nested too deep is not an event, and events are read one by one, because they are thirty times as large in
memory.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchctl.atomic import disk_errors, sync_file, whole_file
from benchctl.documents import json_document
from benchctl.limits import MOST_JOURNAL_BYTES, MOST_JOURNAL_LINES, MOST_LINE_BYTES, cut, read_whole, require_file
from benchctl.recordings.model import Status
from benchctl_instruments.errors import UsageError

Events = Iterable[dict[str, Any]]

ENDED: tuple[Status, ...] = ("complete", "interrupted", "aborted")

_LONGEST_WORDS = 2000
_PIECE = MOST_LINE_BYTES // 8
"""Characters of an invalid line that become one event; JSON writes at most six for each."""


def append_event(path: Path, kind: str, data: dict[str, Any]) -> None:
    """Append a line: `kind`, wall time (UTC) and `data` (plain JSON); it survives `kill -9`."""
    with disk_errors(path), path.open("a", encoding="utf-8") as file:
        file.write(f"{_line(kind, data)}\n")


def sync_journal(path: Path) -> None:
    """Wait until every line is on the disk."""
    with disk_errors(path):
        sync_file(path)


def journal_text(path: Path) -> str:
    """Return the text of the journal; empty if there is none yet.

    Raises
    ------
    UsageError
        It is not a file, cannot be read, or is larger than any campaign makes it.
    """
    require_file(path, "journal ")
    if not path.exists():
        return ""
    text = read_whole(path, MOST_JOURNAL_BYTES, "journal ").decode("utf-8", errors="replace")
    if (lines := text.count("\n")) > MOST_JOURNAL_LINES:
        raise UsageError(
            f"journal {path}: {lines} lines, expected at most {MOST_JOURNAL_LINES}; move it away, the steps are read "
            "without it"
        )
    return text


def events_in(text: str) -> Iterator[dict[str, Any]]:
    """Return the events of a journal, read one by one; lines that are not JSON objects are skipped."""
    found = (_event(line) for line in text.split("\n"))
    return (event for event in found if event is not None)


def mend_journal(path: Path) -> None:
    """Make every line complete; a line that a crash interrupted becomes an event of kind `torn` that holds its text.

    Raises what `journal_text` raises, and `UsageError` if the disk refuses.
    """
    text = journal_text(path)
    lines = text.removesuffix("\n").split("\n") if text else []
    content = "".join(f"{mended}\n" for line in lines for mended in _mended(line)).encode()
    if not path.exists() or path.read_bytes() != content:
        with whole_file(path) as temporary:
            temporary.write_bytes(content)


def last_word(events: Events) -> tuple[Status, str]:
    """Return how a campaign ended whose program is gone, and why: as the program recorded it, else `aborted`."""
    recorded: tuple[Status, str] | None = None
    when = "before anything happened"
    for event in events:
        kind = event.get("kind")
        if kind == "guard":  # written after the program had died
            continue
        when = f"last heard of at {_words(event.get('wall_time', 'an unknown time'))}"
        if kind in ("resume", "step"):
            recorded = None
        elif kind in ("safe", "finish", "recover") and event.get("status") in ENDED:
            recorded = event["status"], _words(event.get("reason", ""))
    return recorded or ("aborted", f"its program died, {when}")


def planned_steps(events: Events) -> int | None:
    """Return the number of planned steps that the program recorded at its last start; None if it recorded none."""
    planned = None
    for event in events:
        count = event.get("planned")
        if isinstance(count, int) and 0 < count <= MOST_JOURNAL_LINES:  # each step is a line at least
            planned = count
    return planned


def _line(kind: str, data: dict[str, Any]) -> str:
    return json.dumps({"kind": kind, "wall_time": datetime.now(UTC).isoformat(), **data}, ensure_ascii=False)


def _event(line: str) -> dict[str, Any] | None:
    if len(line) > MOST_LINE_BYTES:
        return None
    try:
        event = json_document(line, "event")
    except UsageError:
        return None
    return event if isinstance(event, dict) else None


def _mended(line: str) -> list[str]:
    if _event(line) is not None:
        return [line]
    starts = range(0, max(len(line), 1), _PIECE)
    return [_line("torn", {"text": line[start : start + _PIECE]}) for start in starts]


def _words(value: object) -> str:
    """Return the content of an event as one line that can be printed and stored."""
    return cut("".join(character if character.isprintable() else " " for character in str(value)), _LONGEST_WORDS)
