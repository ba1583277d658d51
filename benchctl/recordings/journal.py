"""The journal of a campaign: one JSON object a line, in the order in which things happened.

A crash may leave its last line torn. Whoever reads takes the lines that are whole; whoever goes on writing first makes
an event of the torn one, so that every line is JSON again. Folders come from strangers, too: a line that is too long or
nested too deep is no event, and events are read one by one, since in memory they are thirty times as large.
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
"""Characters of what is no event that become one; JSON makes at most six of each."""


def append_event(path: Path, kind: str, data: dict[str, Any]) -> None:
    """Append a line: `kind`, wall time (UTC) and `data` (plain JSON); it survives `kill -9`."""
    with disk_errors(path), path.open("a", encoding="utf-8") as file:
        file.write(f"{_line(kind, data)}\n")


def sync_journal(path: Path) -> None:
    """Wait until every line is on the disk."""
    with disk_errors(path):
        sync_file(path)


def journal_text(path: Path) -> str:
    """The journal as it stands; empty where there is none yet.

    Raises
    ------
    UsageError
        Where it is no file, cannot be read, or is larger than any campaign makes it.
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
    """The events of a journal, read one by one; lines that are no JSON object are passed over."""
    found = (_event(line) for line in text.split("\n"))
    return (event for event in found if event is not None)


def mend_journal(path: Path) -> None:
    """Let every line be whole; one that a crash tore becomes an event of kind `torn` that holds its text.

    Raises what `journal_text` raises, and `UsageError` where the disk refuses.
    """
    text = journal_text(path)
    lines = text.removesuffix("\n").split("\n") if text else []
    whole = "".join(f"{mended}\n" for line in lines for mended in _mended(line)).encode()
    if not path.exists() or path.read_bytes() != whole:
        with whole_file(path) as temporary:
            temporary.write_bytes(whole)


def last_word(events: Events) -> tuple[Status, str]:
    """How a campaign ended whose program is gone, and why: as that said itself, else `aborted`."""
    said: tuple[Status, str] | None = None
    when = "before anything happened"
    for event in events:
        kind = event.get("kind")
        if kind == "guard":  # written after the program had died
            continue
        when = f"last heard of at {_words(event.get('wall_time', 'an unknown time'))}"
        if kind in ("resume", "step"):
            said = None
        elif kind in ("safe", "finish", "recover") and event.get("status") in ENDED:
            said = event["status"], _words(event.get("reason", ""))
    return said or ("aborted", f"its program died, {when}")


def planned_steps(events: Events) -> int | None:
    """How many steps the campaign was to have, as its program noted when it had last begun; None where it did not."""
    planned = None
    for event in events:
        said = event.get("planned")
        if isinstance(said, int) and 0 < said <= MOST_JOURNAL_LINES:  # each step is a line at least
            planned = said
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
    """What an event says, as one line that can be printed and stored."""
    return cut("".join(character if character.isprintable() else " " for character in str(value)), _LONGEST_WORDS)
