"""Read a running campaign repeatedly: new data, the current activity, and the progress of a soak."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.page_operator import open_question
from benchctl.campaign.soak import SoakWatch
from benchctl.campaign.stop import is_asked
from benchctl.confined import entries_in, open_file
from benchctl.dashboard.data.contents import DIED, RUNNING, contents_of, died_says, known_file, recording_in, status_of
from benchctl.dashboard.data.details import BenchLimit, bench_of, limits_of, measured
from benchctl.dashboard.data.events import Line, event_of, in_words
from benchctl.dashboard.data.readings import News, Readings, StepFeed
from benchctl.dashboard.data.run_state import RunState, ends_utc, left_s, planned_step, step_now
from benchctl.dashboard.data.trails import Trails, Watch
from benchctl.limits import MOST_JOURNAL_BYTES
from benchctl.locks import is_held
from benchctl.recordings.model import BY_HAND
from benchctl.recordings.schema import CAMPAIGN, JOURNAL, LOCK, STEPS
from benchctl.recordings.step_writer import CLOSING_S_PER_SCAN
from benchctl_instruments.errors import UsageError

_POLLED = {
    "power_cycle": "waiting for the unit's supply",
    "mount": "waiting for the unit to be mounted",
    "ask": "waiting for the operator",
    "home": "waiting for the table to be homed",
}
_LONGEST_S = 1e12


def doing(state: RunState, readings: Readings, soak: SoakWatch | None = None) -> str:
    """Return the current activity, according to the journal and the files."""
    if state.ending:
        return "closing the recording" if state.ending == "closing" else "at rest"
    if state.on_hold:
        return "on hold"
    if state.step is None:
        return "preparing the bench"
    recording = readings.index == state.step.index and readings.recorded
    planned = planned_step(state)
    kind = readings.kind if recording or planned is None else planned.kind
    if kind == "soak":
        return soak.state if soak is not None else "going to the set point"
    return _POLLED.get(kind) or ("recording" if recording else "moving and settling")


class SoakFollower:
    """Follow the current soak by its polls, with the same rule for its end as the runner.

    `watch` is None without a soak, or if the journal does not contain its parameters.
    """

    def __init__(self) -> None:
        self._index: int | None = None
        self._watch: SoakWatch | None = None

    def take(self, news: News, state: RunState, bench: Bench | None) -> None:
        """Process the new samples of a step."""
        if state.step is None or news.info.index != state.step.index:
            return
        if news.info.index != self._index:
            self._index, self._watch = news.info.index, _watch_of(state, news.info.t_start, bench)
        polls = [news.channels.get(f"poll_{name}") for name in ("time_s", "chamber_temp_c", "gyro_temp_c")]
        if self._watch is not None and all(poll is not None for poll in polls):
            for now_s, air_c, gyro_c in zip(*polls, strict=True):
                if math.isfinite(air_c):
                    self._watch.see(float(now_s), float(air_c), float(gyro_c))

    def watch(self, state: RunState) -> SoakWatch | None:
        """Return the current soak."""
        return self._watch if state.step is not None and state.step.index == self._index else None


def soak_json(watch: SoakWatch | None, readings: Readings) -> dict[str, Any] | None:
    """Return a soak's progress for the page: `left_s` is the minimum remaining time inside the tolerance."""
    if watch is None:
        return None
    step, held_s = watch.step, watch.held_s
    return {
        "air_c": readings.values["air_c"],
        "setpoint_c": step.setpoint_c,
        "tolerance_c": step.tolerance_c,
        "hold_s": step.hold_s,
        "held_s": held_s,
        "left_s": remaining_s(watch),
        "drift_c_per_min": watch.drift_c_per_min,
        "most_drift_c_per_min": step.drift_c_per_min,
    }


def remaining_s(watch: SoakWatch | None) -> float:
    """Return how much longer the air has to stay within the tolerance [s]; zero without a soak."""
    return 0.0 if watch is None else max(0.0, watch.step.hold_s - (watch.held_s or 0.0))


def _watch_of(state: RunState, begin_s: float, bench: Bench | None) -> SoakWatch | None:
    planned = planned_step(state)
    if planned is None or planned.soak is None or bench is None:
        return None
    step = replace(planned.soak, timeout_s=_LONGEST_S)  # the runner checks the timeout
    return SoakWatch(step, from_c=step.setpoint_c, begin_s=begin_s, limits=bench.limits)


__all__ = ["FIRST_EVENTS", "Follower", "Watch"]

GONE = "unreadable"
_LOCK_EVERY_S = 1.0
_YOUNG_S = 5.0
FIRST_EVENTS = 20
"""Number of events in the first state; `events_after` reads all."""


class Follower:
    """Reads one campaign for all its viewers; not thread-safe."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._journal = JournalTail(path)
        self._state = RunState()
        self._status = ""
        self._samples = 0
        self._lock_looked_s = -_LOCK_EVERY_S
        self._arrived_s = time.monotonic() - _age_s(path)
        self._bench: Bench | None = None
        self._limits: list[BenchLimit] = []
        self._begin()

    def look(self, watches: Sequence[Watch] = ()) -> dict[str, Any]:
        """Return the current state: the keys of the live page's message; `series` has an entry per watch, in order.

        `events` are those since the previous call; at the first call the last few. A campaign whose folder is gone has
        the status `unreadable`, with a sentence in `says`. Never raises for changes of a campaign in the meantime.
        """
        first = self._journal.lines == 0
        lines = self._journal.new_lines()
        self._state.take(event for _, event in lines if event is not None)
        before, self._status = self._status, self._status_now()
        if self._status == RUNNING:
            if before not in (RUNNING, ""):
                self._begin()  # it was resumed: its files may have been renamed in the meantime
            self._know_bench()
        elif before in (RUNNING, DIED) and self._status not in (RUNNING, DIED):
            # assembled, perhaps with steps that were not read before: the trails are now read from the recording
            self._trails = Trails(self._path, StepFeed(self._path))
        trouble = self._feed() if self._status in (RUNNING, DIED) else ""
        if lines:
            self._arrived_s = time.monotonic()
        now_s = max(self._readings.now_s or 0.0, self._state.last.bench_s if self._state.last else 0.0)
        return self._told(now_s, trouble) | {
            "events": in_words(lines)[-FIRST_EVENTS if first else 0 :],
            "series": self._trails.watched(watches, now_s),
        }

    def close(self) -> None:
        """Do nothing: no files stay open between calls."""

    def _begin(self) -> None:
        self._readings = Readings()
        self._soak = SoakFollower()
        self._steps = StepFeed(self._path)
        self._trails = Trails(self._path, self._steps)

    def _status_now(self) -> str:
        """Return the campaign's status; its lock is checked at most once per second."""
        if not self._path.exists():
            return GONE
        if recording_in(self._path) is not None or not (self._path / STEPS).is_dir():
            with suppress(UsageError, OSError):
                contents = contents_of(self._path)
                self._samples = sum(piece.info.samples for piece in contents.pieces)
                return status_of(contents)
            return self._status or GONE
        if time.monotonic() - self._lock_looked_s < _LOCK_EVERY_S and self._status in (RUNNING, DIED):
            return self._status
        self._lock_looked_s = time.monotonic()
        if is_held(self._path / LOCK) or self._is_being_made():
            return RUNNING
        # it may have been closed since the check for the recording
        return DIED if recording_in(self._path) is None else self._status or DIED

    def _is_being_made(self) -> bool:
        """Return whether the folder is so new that its program may not hold the lock yet."""
        with suppress(OSError):
            young = time.time() - (self._path / STEPS).stat().st_mtime < _YOUNG_S
            return young and not (self._path / CAMPAIGN).exists()
        return False

    def _know_bench(self) -> None:
        if not self._limits:
            with suppress(UsageError):
                meta = known_file(self._path / CAMPAIGN).meta
                self._bench = bench_of(meta) if meta is not None else None
                self._limits = limits_of(self._bench)

    def _feed(self) -> str:
        """Read the new samples; return the reason if that is impossible."""
        try:
            for news in self._steps.news():
                self._soak.take(news, self._state, self._bench)
                for channel, time_s, values in self._readings.take(news):
                    self._trails.add(channel, time_s, values)
                if news.over:
                    self._trails.step_over()
                if news.channels or news.over:
                    self._arrived_s = time.monotonic()
        except UsageError as err:
            return str(err)
        return ""

    def _told(self, now_s: float, trouble: str) -> dict[str, Any]:
        state, readings, running = self._state, self._readings, self._status == RUNNING
        values = readings.values
        age_s = time.monotonic() - self._arrived_s
        patience = patience_s(state, readings, self._bench)
        stalled = running and patience is not None and age_s > patience
        soak = self._soak.watch(state) if running else None
        waits_s = remaining_s(soak)
        left = left_s(state, now_s, waits_s) if running else None
        return {
            "status": self._status,
            "doing": doing(state, readings, soak) if running else "",
            "soak": soak_json(soak, readings),
            "now_s": now_s,
            "step": step_now(state, now_s, waits_s),
            "left_s": left,
            "ends_utc": ends_utc(state, now_s, time.time(), left),
            "samples": self._samples_so_far() if self._status in (RUNNING, DIED) else self._samples,
            "values": {name: value for name, value in values.items() if name != "angle_deg"},
            "noise_says": readings.noise_says,
            "limits": [limit.held_against(measured(values, limit.quantity)) for limit in self._limits],
            "data_age_s": age_s,
            "stalled": stalled,
            "died": self._status == DIED,
            "says": self._says(stalled, age_s, trouble),
            "stop_asked": running and is_asked(self._path),
            "question": asdict(question) if running and (question := open_question(self._path)) else None,
        }

    def _samples_so_far(self) -> int:
        """Return the samples of complete steps according to the journal, and of the step that is being written."""
        over, index = self._state.samples, self._readings.index
        return over if index in self._state.samples_of else over + self._readings.streamed

    def _says(self, stalled: bool, age_s: float, trouble: str) -> str:
        if self._status == GONE:
            return "the campaign's folder is gone, or cannot be read"
        if self._status == DIED:
            return died_says(self._path)
        if stalled:
            return f"nothing has come for {age_s:.0f} s{trouble and f' ({trouble})'}; look at the bench"
        return f"on hold: {self._state.on_hold}" if self._state.on_hold and self._status == RUNNING else ""


def _age_s(path: Path) -> float:
    """Return the time since the last change of a campaign's files."""
    latest_s = 0.0
    with suppress(OSError):
        for file in (path / JOURNAL, *(path / STEPS / name for name in entries_in(path / STEPS))):
            latest_s = max(latest_s, file.lstat().st_mtime)
    return max(0.0, time.time() - latest_s) if latest_s else 0.0


_SILENCE_S = 10.0
"""Default for benches that do not state how long their instruments may be silent."""


def patience_s(state: RunState, readings: Readings, bench: Bench | None) -> float | None:
    """Return the normal wall time without a sample or a line of the journal; None while waiting for a person.

    It is the bench's `silence_s`, and more when there are no samples: while the table stops, spins up and settles
    before a step is recorded, while a step's file is rewritten, and while the files are assembled.
    """
    planned = planned_step(state)
    if state.on_hold or (planned is not None and planned.kind in BY_HAND):
        return None
    silence_s = bench.limits.silence_s if bench is not None else _SILENCE_S
    if state.ending:
        return silence_s + state.samples * CLOSING_S_PER_SCAN
    if state.step is None or readings.index != state.step.index or not readings.recorded:
        spins_up_s = 4.0 * bench.limits.rate_dps / bench.limits.acceleration_dps2 if bench is not None else 0.0
        settles_s = planned.t_end_s - planned.t_start_s - planned.streamed_s if planned and planned.streamed_s else 0.0
        return silence_s + 10.0 + (spins_up_s + settles_s) / (bench.time_factor if bench is not None else 1.0)
    return silence_s + readings.streamed * CLOSING_S_PER_SCAN


class JournalTail:
    """Reads new lines of a journal; of one that was replaced, for example to repair a line, only the unread lines.

    `lines` counts those read so far.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        self._file = (0, 0)
        self._place = 0
        self.lines = 0

    def new_lines(self) -> list[Line]:
        """Return the complete lines since the last call; none if there is no readable journal."""
        try:
            with open_file(self._path) as file:
                return self._read(file.fileno())
        except OSError:
            return []

    def _read(self, descriptor: int) -> list[Line]:
        stat = os.fstat(descriptor)
        skipped = 0
        if (stat.st_dev, stat.st_ino) != self._file or stat.st_size < self._place:
            skipped = self.lines if stat.st_size >= self._place else 0
            self._file, self._place, self.lines = (stat.st_dev, stat.st_ino), 0, 0
        os.lseek(descriptor, self._place, os.SEEK_SET)
        content = b""
        while self._place + len(content) < min(stat.st_size, MOST_JOURNAL_BYTES):
            more = os.read(descriptor, stat.st_size - self._place - len(content))
            if not more:
                break
            content += more
        complete, _, _ = content.rpartition(b"\n")
        if not complete:
            return []
        self._place += len(complete) + 1
        first = self.lines + 1
        lines = list(enumerate(complete.split(b"\n"), first))
        self.lines += len(lines)
        return [(number, event_of(line)) for number, line in lines if number > skipped]
