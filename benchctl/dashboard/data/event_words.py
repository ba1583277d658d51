"""Events of a campaign's journal as a person reads them, and how much they matter."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Literal

from benchctl.limits import cut

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
