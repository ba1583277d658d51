"""Read a campaign's journal line by line, from its folder or its recording, and convert its events to sentences."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import IO, Any, Literal

from benchctl.confined import open_file
from benchctl.dashboard.data.contents import recording_in
from benchctl.limits import MOST_JOURNAL_BYTES, MOST_LINE_BYTES, cut, require_file
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import attribute
from benchctl.recordings.journal import events_in
from benchctl.recordings.reader import is_open_recording
from benchctl.recordings.schema import JOURNAL
from benchctl_instruments.errors import UsageError

Level = Literal["info", "warning", "bad"]
Event = Mapping[str, Any]
Sentence = tuple[str, Level]

_LONGEST = 400


def sentence_of(event: Event) -> Sentence | None:
    """Return the sentence of an event, and its level; None for an event that is for programs only.

    The events are untrusted: whatever they contain, the result is one line of plain text.
    """
    kind = str(event.get("kind", ""))
    if kind == "plan":
        return None
    other = "{says}" if event.get("says") else _literal(kind.replace("_", " "))
    sentence, level = _CASES[kind](event) if kind in _CASES else _SENTENCES.get(kind, (other, "info"))
    text = sentence.format_map(_Fields(event))
    return cut("".join(letter if letter.isprintable() else " " for letter in text), _LONGEST), level


class _Fields:
    """The fields of an event by name; of names separated by `|` the first that exists."""

    def __init__(self, event: Event) -> None:
        self._event = event

    def __getitem__(self, names: str) -> _Field:
        return _Field(next((self._event[name] for name in names.split("|") if name in self._event), None))


class _Field:
    """A value of an event: as text, as an integer (`:,`) or as a number to 6 decimals (`:g`), 3 (`:3g`); else ?."""

    def __init__(self, value: object) -> None:
        self._value = value

    def __format__(self, form: str) -> str:
        value = self._value
        if not form:
            return "" if value is None else str(value)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return "?"
        if form.endswith("g"):
            return f"{round(value, int(form[:-1] or 6)) + 0.0:g}"
        return f"{value:,}" if isinstance(value, int) else "?"


_SENTENCES: Mapping[str, Sentence] = {
    "certificate": ("{says}", "warning"),
    "cut": ("step {index:,} was cut: {name}, {samples:,} samples", "warning"),
    "frames_lost": (
        "{frames:,} frames of the digital gyro are missing, at {gaps:,} places up to {time_s:g} s",
        "warning",
    ),
    "gap": ("gap in the stream at {time_s:g} s: {scans:,} scans are missing", "warning"),
    "motion": ("the step is not complete: {says}", "bad"),
    "notify": ("{says}", "warning"),
    "operator": ("done by {by}: {says}, after {waited_s:g} s", "info"),
    "recovered": ("recovered: {says}", "warning"),
    "resume": ("resumed with {whole:,} complete steps; started {day:,} times before", "info"),
    "started": ("started by {by}", "info"),
    "step": ("step {number|index:,} begins: {name}", "info"),
    "torn": ("a line of the journal was torn by the program's death", "warning"),
    "unreadable": ("a crash left {file} unreadable: {why}", "bad"),
    "waiting": ("waiting for {by}: {says}", "warning"),
    "whole": ("step {index:,} is complete: {name}, {samples:,} samples", "info"),
}


def _prepared(event: Event) -> Sentence:
    instruments = event.get("instruments")
    names = ", ".join(str(name).replace("_", " ") for name in instruments) if isinstance(instruments, dict) else ""
    return f"ready: {{planned:,}} steps planned{names and f'; {_literal(names)} answered'}", "info"


def _silence(event: Event) -> Sentence:
    return f"{_literal(event.get('instrument', '')).replace('_', ' ')} is silent: {{says}}", "warning"


def _gyro_fault(event: Event) -> Sentence:
    if event.get("says") == "over":
        return "its fault is over", "info"
    return "the digital gyro states a fault: {says}", "warning"


def _interlock(event: Event) -> Sentence:
    if not event.get("on"):
        return "interlock is off again: {says} ({value:g})", "info"
    return "interlock: {says} ({value:g}), action {action}", "bad"


def _hold(event: Event) -> Sentence:
    if event.get("on"):
        return "on hold, the table at rest: {says}", "warning"
    return "goes on, after {waited_s:g} s on hold", "info"


def _guard(event: Event) -> Sentence:
    if "problems" in event:
        return "guard: {says}", "bad" if event["problems"] else "warning"
    return "guard: {says}", "info" if str(event.get("says", "")).endswith("guards the run") else "warning"


def _safe(event: Event) -> Sentence:
    problems = event.get("problems")
    if problems:
        listed = "; ".join(map(str, problems)) if isinstance(problems, list) else str(problems)
        return f"NOT KNOWN TO BE AT REST: {_literal(listed)}", "bad"
    return "at rest, read back: table at {rate_dps:3g} deg/s, chamber set to {chamber_setpoint_c:g} °C", "info"


def _ended(event: Event) -> Sentence:
    levels: Mapping[str, Level] = {"complete": "info", "interrupted": "warning"}
    level = levels.get(str(event.get("status")), "bad")
    return "{status}: {reason}" if event.get("reason") else "{status}", level


def _recover(event: Event) -> Sentence:
    sentence, level = _ended(event)
    return f"closed afterwards by benchctl recover: {sentence}", level


def _literal(value: object) -> str:
    """Return a text for use in a format string: its braces are doubled."""
    return str(value).replace("{", "{{").replace("}", "}}")


_CASES: Mapping[str, Callable[[Event], Sentence]] = {
    "finish": _ended,
    "guard": _guard,
    "gyro_fault": _gyro_fault,
    "hold": _hold,
    "interlock": _interlock,
    "prepared": _prepared,
    "recover": _recover,
    "safe": _safe,
    "silence": _silence,
}
"""Events whose sentence depends on their content."""


Line = tuple[int, dict[str, Any] | None]
"""The number of a line, from 1, and its event; None if it is not one."""


def lines_after(path: Path, number: int) -> Iterator[Line]:
    """Yield the complete lines of a campaign's journal after line `number`; an incomplete last line is left for later.

    Raises `UsageError` if the journal cannot be read.
    """
    with closing(_opened(path)) as file:
        read = 0
        for count, line in enumerate(file, 1):
            read += len(line)
            if not line.endswith(b"\n") or read > MOST_JOURNAL_BYTES:
                return
            if count > number:
                yield count, event_of(line)


def event_of(line: bytes) -> dict[str, Any] | None:
    """Parse the event in a line; None if it is not one."""
    if len(line) > MOST_LINE_BYTES:
        return None
    return next(events_in(line.decode("utf-8", "replace").removesuffix("\n")), None)


def _opened(path: Path) -> IO[bytes]:
    journal = path / JOURNAL
    if path.is_dir():
        require_file(journal, "journal ")
        try:
            return open_file(journal)
        except FileNotFoundError:
            pass
        except OSError as err:
            raise UsageError(f"journal {journal}: cannot be read: {err.strerror or err}") from err
    file = recording_in(path)
    if file is None or is_open_recording(path):
        return io.BytesIO()
    try:
        with open_ours(file) as opened:
            kept = attribute(opened, "provenance_journal", "")
    except ValueError as err:
        raise UsageError(f"{file}: its journal is damaged: {err}") from err
    return io.BytesIO(str(kept).encode("utf-8"))


MOST_EVENTS = 500


def events_after(path: Path, number: int) -> dict[str, Any]:
    """Return the events after line `number` of a campaign's journal, at most 500, and the next number (`next`).

    Raises `UsageError` if the campaign or its journal cannot be read.
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
    """Return the events in some lines, each with its number, time (UTC), kind, sentence and level."""
    found = []
    for number, event in lines:
        sentence = sentence_of(event) if event is not None else None
        if event is not None and sentence is not None:
            found.append(
                {
                    "number": number,
                    "wall_time": str(event.get("wall_time", "")),
                    "kind": str(event.get("kind", "")),
                    "says": sentence[0],
                    "level": sentence[1],
                }
            )
    return found
