"""A campaign's journal, read line by line: that in its folder or its recording, and its events in words."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import IO, Any, Literal

from benchctl.confined import open_file
from benchctl.dashboard.data.contents import is_open_recording, recording_in
from benchctl.limits import MOST_JOURNAL_BYTES, MOST_LINE_BYTES, cut, require_file
from benchctl.recordings.hdf5_files import open_ours
from benchctl.recordings.hdf5_guard import attribute
from benchctl.recordings.journal import events_in
from benchctl.recordings.schema import JOURNAL
from benchctl_instruments.errors import UsageError

Level = Literal["info", "warning", "bad"]
Event = Mapping[str, Any]
Told = tuple[str, Level]

_LONGEST = 400


def told(event: Event) -> Told | None:
    """What an event says, and its level; None of one that is for programs only.

    Events come from files that anybody may have written: whatever is in them, this gives one line of plain text.
    """
    kind = str(event.get("kind", ""))
    if kind == "plan":
        return None
    say = _WORDS.get(kind)
    says, level = say(event) if say else (_text(event, "says") or kind.replace("_", " "), "info")
    return cut("".join(letter if letter.isprintable() else " " for letter in says), _LONGEST), level


def _prepared(event: Event) -> Told:
    instruments = event.get("instruments")
    names = ", ".join(str(name).replace("_", " ") for name in instruments) if isinstance(instruments, dict) else ""
    return f"ready: {_count(event, 'planned')} steps planned{names and f'; {names} answered'}", "info"


def _resume(event: Event) -> Told:
    return (
        f"gone on with, {_count(event, 'whole')} steps being whole; begun {_count(event, 'day')} times before",
        "info",
    )


def _step(event: Event) -> Told:
    return f"step {_count(event, 'number', 'index')} begins: {_text(event, 'name')}", "info"


def _whole(event: Event) -> Told:
    return f"step {_count(event, 'index')} is whole: {_text(event, 'name')}, {_count(event, 'samples')} samples", "info"


def _cut(event: Event) -> Told:
    return (
        f"step {_count(event, 'index')} was cut: {_text(event, 'name')}, {_count(event, 'samples')} samples",
        "warning",
    )


def _certificate(event: Event) -> Told:
    return _text(event, "says"), "warning"


def _gap(event: Event) -> Told:
    return f"gap in the stream at {_number(event, 'time_s')} s: {_count(event, 'scans')} scans are missing", "warning"


def _frames_lost(event: Event) -> Told:
    where = f"{_count(event, 'gaps')} places up to {_number(event, 'time_s')} s"
    return f"{_count(event, 'frames')} frames of the digital gyro are missing, at {where}", "warning"


def _motion(event: Event) -> Told:
    return f"the step is not complete: {_text(event, 'says')}", "bad"


def _silence(event: Event) -> Told:
    return f"{_text(event, 'instrument').replace('_', ' ')} is silent: {_text(event, 'says')}", "warning"


def _recovered(event: Event) -> Told:
    return f"recovered: {_text(event, 'says')}", "warning"


def _gyro_fault(event: Event) -> Told:
    says = _text(event, "says")
    return (f"the digital gyro states a fault: {says}", "warning") if says != "over" else ("its fault is over", "info")


def _interlock(event: Event) -> Told:
    says, value = _text(event, "says"), _number(event, "value")
    if not event.get("on"):
        return f"interlock is off again: {says} ({value})", "info"
    return f"interlock: {says} ({value}), action {_text(event, 'action')}", "bad"


def _hold(event: Event) -> Told:
    if event.get("on"):
        return f"on hold, the table at rest: {_text(event, 'says')}", "warning"
    return f"goes on, after {_number(event, 'waited_s')} s on hold", "info"


def _operator(event: Event) -> Told:
    return f"done by {_text(event, 'by')}: {_text(event, 'says')}, after {_number(event, 'waited_s')} s", "info"


def _guard(event: Event) -> Told:
    if "problems" not in event:
        says = _text(event, "says")
        return f"guard: {says}", "info" if says.endswith("guards the run") else "warning"
    return f"guard: {_text(event, 'says')}", "bad" if event["problems"] else "warning"


def _safe(event: Event) -> Told:
    problems = event.get("problems")
    if problems:
        listed = "; ".join(map(str, problems)) if isinstance(problems, list) else str(problems)
        return f"NOT KNOWN TO BE AT REST: {listed}", "bad"
    place = f"table at {_number(event, 'rate_dps', 3)} deg/s, chamber set to {_number(event, 'chamber_setpoint_c')} °C"
    return f"at rest, read back: {place}", "info"


def _ended(event: Event) -> Told:
    status, reason = _text(event, "status"), _text(event, "reason")
    level: Level = "info" if status == "complete" else "warning" if status == "interrupted" else "bad"
    return f"{status}{reason and f': {reason}'}", level


def _recover(event: Event) -> Told:
    says, level = _ended(event)
    return f"closed afterwards by benchctl recover: {says}", level


def _torn(event: Event) -> Told:
    return "a line of the journal was torn by the program's death", "warning"


def _unreadable(event: Event) -> Told:
    return f"a crash left {_text(event, 'file')} unreadable: {_text(event, 'why')}", "bad"


_WORDS: Mapping[str, Callable[[Event], Told]] = {
    "certificate": _certificate,
    "cut": _cut,
    "finish": _ended,
    "frames_lost": _frames_lost,
    "gap": _gap,
    "guard": _guard,
    "gyro_fault": _gyro_fault,
    "hold": _hold,
    "interlock": _interlock,
    "motion": _motion,
    "operator": _operator,
    "prepared": _prepared,
    "recover": _recover,
    "recovered": _recovered,
    "resume": _resume,
    "safe": _safe,
    "silence": _silence,
    "step": _step,
    "torn": _torn,
    "unreadable": _unreadable,
    "whole": _whole,
}


def _text(event: Event, key: str) -> str:
    return str(event.get(key, ""))


def _count(event: Event, *keys: str) -> str:
    """The first of some whole numbers that is there."""
    for key in keys:
        value = event.get(key)
        if isinstance(value, int) and not isinstance(value, bool):
            return f"{value:,}"
    return "?"


def _number(event: Event, key: str, decimals: int = 6) -> str:
    value = event.get(key)
    if not isinstance(value, int | float) or not math.isfinite(value):
        return "?"
    return f"{round(value, decimals) + 0.0:g}"


Line = tuple[int, dict[str, Any] | None]
"""The number of a line, from 1, and the event that it is; None where it is none."""


def lines_after(path: Path, number: int) -> Iterator[Line]:
    """The whole lines of a campaign's journal behind line `number`; a last one without its end is left for later.

    Raises `UsageError` where the journal cannot be read.
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
    """The event that a line is; None where it is none."""
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
