"""The journal of a station: what was started, queued, removed and signed at the live page, when and by whom.

The queue is what the journal states, so it survives the end of the server. One JSON object per line, as in a campaign:

```
{"kind": "queued", "order": "5f0c…", "procedure": "incoming", "serial": "SN-17", "by": "A. Ohm"}
{"kind": "removed", "order": "5f0c…", "by": "B. Volt"}
{"kind": "started", "order": "5f0c…", "procedure": "incoming", "serial": "SN-17", "by": "A. Ohm", "campaign": "2026…"}
{"kind": "resumed", "by": "B. Volt"}                      the run that was started last
{"kind": "refused", "reason": "rate_table is in use"}     the start before this line; its order goes back to its place
{"kind": "over", "reason": ""}                            why the run did not end properly; empty: it did
{"kind": "held", "reason": "…"}                           no run of the queue starts
{"kind": "go_on", "by": "B. Volt"}                        until somebody lets the queue go on
{"kind": "signed", "by": "C. Amp", "campaign": "2026…", "signed": {"says": "signed by …", "problems": []}}
```
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchctl.recordings.journal import append_event, events_in, journal_text, mend_journal
from benchctl_instruments.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """A released procedure for a unit, ordered by a person; `order` is the id that the client gave it."""

    order: str
    procedure: str
    serial: str
    by: str


@dataclass(frozen=True, slots=True, kw_only=True)
class StationRun:
    """The run that was started last; `fault` is None while it goes on, then empty if it ended properly."""

    order: Order
    campaign: str
    fault: str | None = None


class StationJournal:
    """The state of a station according to its journal, which only one process writes; not thread-safe.

    `waiting` is the queue. `held` is why it holds, empty if it does not; `hold` counts the events up to that, so that a
    client that lets it go on names the hold that it means. Raises `UsageError` if the file is not such a journal.
    """

    def __init__(self, path: Path) -> None:
        self.waiting: tuple[Order, ...] = ()
        self.run: StationRun | None = None
        self.held, self.hold = "", 0
        self._path, self._count, self._orders = path, 0, set[str]()
        self._before: tuple[tuple[Order, ...], StationRun | None] = (), None
        if path.exists():
            mend_journal(path)
        for event in events_in(journal_text(path)):
            try:
                self._apply(event)
            except (KeyError, TypeError) as err:
                raise UsageError(f"journal {path}: event {self._count} is not a station's; move the file away") from err

    def note(self, kind: str, **data: Any) -> None:
        """Append an event; raises `UsageError` if the disk refuses."""
        append_event(self._path, kind, data)
        self._apply({"kind": kind, **data})

    def knows(self, order: str) -> bool:
        """Return whether an order of this id was placed before."""
        return order in self._orders

    @property
    def last_serial(self) -> str:
        """The unit of the last order of the queue, otherwise of the last run; empty if there is none."""
        if self.waiting:
            return self.waiting[-1].serial
        return "" if self.run is None else self.run.order.serial

    def _apply(self, event: Mapping[str, Any]) -> None:
        self._count += 1
        match event["kind"]:
            case "queued":
                self.waiting = (*self.waiting, self._order(event))
            case "removed":
                self.waiting = self._without(event["order"])
            case "started":
                self._before = self.waiting, self.run
                self.run = StationRun(order=self._order(event), campaign=event["campaign"])
                self.waiting = self._without(event["order"])
            case "resumed" if self.run is not None:
                self._before = self.waiting, self.run
                self.run = replace(self.run, fault=None)
            case "refused":
                self.waiting, self.run = self._before
            case "over" if self.run is not None:
                self.run = replace(self.run, fault=event["reason"])
                if event["reason"]:
                    self._hold(f"{self.run.campaign} did not end properly: {event['reason']}")
            case "held":
                self._hold(event["reason"])
            case "go_on":
                self.held = ""

    def _hold(self, reason: str) -> None:
        self.held, self.hold = reason, self._count

    def _order(self, event: Mapping[str, Any]) -> Order:
        self._orders.add(event["order"])
        return Order(**{name: event[name] for name in Order.__slots__})

    def _without(self, order: str) -> tuple[Order, ...]:
        return tuple(one for one in self.waiting if one.order != order)
