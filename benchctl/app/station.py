"""The procedures that a lab has released, checked and started as at the command line, by processes of their own.

The checks are `benchctl check`, the runs `benchctl run`: nothing starts here that the command line refuses. A run
outlives the process that started it; what it prints goes to `NAME.log`, beside its campaign's folder. A run that is
queued starts when the one before it is complete and has left the bench in its safe state.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchctl.app.run import new_folder, questions_asked
from benchctl.app.station_journal import Order, StationJournal, StationRun
from benchctl.bench import load_bench
from benchctl.campaign.again import parameter_text
from benchctl.campaign.check import bench_time_s, problems
from benchctl.campaign.page_operator import forget_question
from benchctl.campaign.reserved import lock_file, make_lock_folder
from benchctl.documents import json_document, read_json
from benchctl.locks import held, is_held
from benchctl.metrology.limit_file import read_limits
from benchctl.own_process import own_process
from benchctl.plan.find import find_procedure
from benchctl.recordings.journal import events_in, journal_text, last_word
from benchctl.recordings.schema import JOURNAL, LOCK
from benchctl.reports.acceptance.signed import JSON as ACCEPTANCE
from benchctl.reports.acceptance.signed import STATEMENT
from benchctl_instruments.errors import UsageError

_CHECKED_WITHIN_S = 60.0
_BEGUN_WITHIN_S = 60.0
"""Wall time that silent instruments may take to be given up."""


class NotStartedError(UsageError):
    """The run was refused, another one is on the bench, or the queue is not as the client saw it; nothing has moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleasedProcedure:
    """A released procedure as the lab names it; `command` are the arguments of `check` and `run`, `limits` judge it."""

    name: str
    title: str
    says: str
    steps: int
    bench_time_s: float | None
    questions: int
    command: tuple[str, ...]
    limits: Path | None


class NotSignedError(UsageError):
    """An acceptance cannot be signed, or not any more; nothing was signed."""


class Station:
    """A bench whose released procedures can be started into the folder `root`, one at a time; not thread-safe.

    `journal` states the queue and who did what, in a file in `root`; it exists while the station is `reserved`. Raises
    `UsageError` if the bench cannot be read, releases nothing or what cannot be planned, or is turned by hand.
    """

    def __init__(self, bench_toml: Path, root: Path) -> None:
        self._file, self.root = bench_toml.resolve(), root.resolve()
        self.bench = load_bench(str(self._file))
        if not self.bench.released:
            raise UsageError(f"{bench_toml}: releases no procedure; add [released.NAME] with procedure = …")
        if self.bench.by_hand:
            raise UsageError(
                f"{bench_toml}: its table is turned by hand; its runs begin at a terminal, beside the table"
            )
        laboratory = self.bench.laboratory
        self.key = self._file.parent / laboratory.signing_key if laboratory and laboratory.signing_key else None
        if self.key is not None and not self.key.is_file():
            raise UsageError(f"{bench_toml}: laboratory.signing_key: expected a key file, there is no {self.key}")
        self.procedures = {name: self._released(name) for name in self.bench.released}
        self._process: subprocess.Popen[bytes] | None = None
        self._journal_file = self.root / f"queue-{re.sub(r'[^A-Za-z0-9._+-]+', '-', self.bench.name)}.jsonl"
        self.journal: StationJournal

    @contextmanager
    def reserved(self, purpose: str) -> Iterator[None]:
        """Let no other process start runs of this bench from a page; raises `UsageError` if one does, and names it."""
        make_lock_folder()
        locks = [lock_file(str(self._file)), lock_file(str(self._journal_file))]
        with held(locks, f"{self._file}: its live page", purpose):
            self.journal = StationJournal(self._journal_file)
            yield

    def _released(self, name: str) -> ReleasedProcedure:
        released = self.bench.released[name]
        is_file = released.procedure.endswith(".py")
        place = str(self._file.parent / released.procedure) if is_file else released.procedure
        texts = {key: parameter_text(value) for key, value in released.parameters.items()}
        try:
            procedure = find_procedure(place)
            plan = procedure.expand(texts)
            limits = self._file.parent / released.limits if released.limits else None
            if limits is not None:
                read_limits(limits)
        except UsageError as err:
            raise UsageError(f"{self._file}: released.{name}: {err}") from err
        playable = not problems(plan, self.bench)
        return ReleasedProcedure(
            name=name,
            title=released.title or name,
            says=procedure.says,
            steps=len(plan.steps),
            bench_time_s=bench_time_s(plan, self.bench) if playable else None,
            questions=len(questions_asked(plan, self.bench)),
            command=(place, *(f"--parameter={key}={text}" for key, text in texts.items())),
            limits=limits,
        )

    def check(self, name: str, serial: str) -> dict[str, Any]:
        """Return the result of `benchctl check`; `ok` is false where it refuses, for `error`.

        While a run started here is on the bench, its instruments are not identified. Raises `NotStartedError` if there
        is no answer.
        """
        offline = ["--offline"] if self._is_on(self.journal.run) else []
        arguments = ["check", *self._command(name, serial), "--out", str(self.root), *offline, "--json", "-"]
        checking = own_process("benchctl", arguments, stderr=subprocess.DEVNULL)
        try:
            printed = checking.communicate(timeout=_CHECKED_WITHIN_S)[0]
        except subprocess.TimeoutExpired as err:
            checking.terminate()
            checking.communicate()
            raise NotStartedError(
                f"benchctl check has no answer after {_CHECKED_WITHIN_S:g} s; look at the bench"
            ) from err
        found = json_document(printed, "the answer of benchctl check")
        return dict(found)

    def start(self, order: Order) -> Path:
        """Start a released procedure on a unit for a person; return its campaign's folder once it has begun.

        The queue, if it was held, goes on behind this run.

        Raises
        ------
        NotStartedError
            The run refuses, as `benchctl run` does, a run started here is still on the bench, or it has not begun in
            time; or the order was placed before.
        """
        self._refuse_run()
        self._refuse_known(order)
        folder = self._begin(order)
        self._let_go_on(order.by)
        return folder

    def resume(self, hold: int, who: str) -> Path:
        """Resume the run that was started last for a person, and let the queue go on behind it; otherwise as `start`.

        Raises `NotStartedError` if the queue does not hold as the person has seen it, or that run has ended properly.
        """
        self._refuse_run()
        self._require_hold(hold)
        run = self.journal.run
        if run is None or not run.fault or run.order.procedure not in self.procedures:
            raise NotStartedError("no run that ended early can be resumed here; let the queue go on, or start another")
        folder = self.root / run.campaign
        forget_question(folder)  # of the run that ended: it must not be answered while this one begins
        self.journal.note("resumed", by=who)
        self._launch(folder, run.order, who, "--resume", str(folder), "--yes")
        self._let_go_on(who)
        return folder

    def queue(self, order: Order) -> None:
        """Put a released procedure on a unit at the end of the queue.

        Raises `NotStartedError` if the order was placed before, or if another unit comes before this one and the
        procedure asks no question, so that the unit cannot be changed.
        """
        self._refuse_known(order)
        before = self.journal.last_serial
        if before not in ("", order.serial) and not self.procedures[order.procedure].questions:
            raise NotStartedError(
                f"{order.procedure} has no step in which {before} is replaced by {order.serial}; add Mount or Ask, or"
                " start it when the unit is mounted"
            )
        self.journal.note("queued", **asdict(order))

    def remove(self, order: str, who: str) -> None:
        """Remove an order from the queue; `NotStartedError` if it is not in it."""
        if not any(one.order == order for one in self.journal.waiting):
            raise NotStartedError("this order is not in the queue any more; look at it again")
        self.journal.note("removed", order=order, by=who)

    def go_on(self, hold: int, who: str) -> None:
        """Let a queue that holds go on; `NotStartedError` if it does not hold as the person has seen it."""
        self._require_hold(hold)
        self.journal.note("go_on", by=who)

    def advance(self) -> None:
        """Note the end of the run, and start the next one of the queue where it may start; to be called repeatedly."""
        run = self.journal.run
        if run is not None and run.fault is None:
            if self._is_on(run):
                return
            self.journal.note("over", reason=_fault(self.root / run.campaign))
        if self.journal.waiting and not self.journal.held:
            order = self.journal.waiting[0]
            try:
                self._start_checked(order)
            except UsageError as err:
                self.journal.note("held", reason=f"{order.procedure} of {order.serial} cannot start: {err}")

    def sign(self, folder: Path, verdict: str) -> None:
        """Sign the acceptance of a campaign with the laboratory's key, as `benchctl accept --sign` does.

        The limits are those of the station that the campaign was judged by, `verdict` is what the signer has seen. Safe
        beside the other methods. Raises `NotSignedError`.
        """
        if self.key is None:
            raise NotSignedError(f"{self._file}: names no key; add signing_key to [laboratory]")
        if (folder / STATEMENT).exists():
            raise NotSignedError(f"{folder.name} is signed already; benchctl verify states by whom")
        found = read_json(folder / ACCEPTANCE, "acceptance") if (folder / ACCEPTANCE).exists() else {}
        if not isinstance(found, dict) or found.get("verdict") != verdict:
            raise NotSignedError(f"the verdict on {folder.name} is not {verdict} any more; look at it again")
        limits = self._limits_of(found)
        if limits is None:
            raise NotSignedError(
                f"{folder.name} was judged by other limits than {self._file} names today; judge it by benchctl accept"
            )
        arguments = ["accept", str(folder), "--limits", str(limits), "--sign", str(self.key), "--json", "-"]
        signing = own_process("benchctl", arguments, stderr=subprocess.DEVNULL)
        answer = dict(json_document(signing.communicate()[0], "the answer of benchctl accept"))
        if "statement" not in answer:
            raise NotSignedError(str(answer.get("error", "")))

    def _limits_of(self, acceptance: Mapping[str, Any]) -> Path | None:
        """Return the file of released limits that an acceptance names by its digest; None if there is none."""
        stated = acceptance.get("limits")
        digest = stated.get("sha256") if isinstance(stated, dict) else None
        files = (one.limits for one in self.procedures.values() if one.limits is not None)
        return next((file for file in files if hashlib.sha256(file.read_bytes()).hexdigest() == digest), None)

    def _start_checked(self, order: Order) -> None:
        if order.procedure not in self.procedures:
            raise NotStartedError("the lab has released no such procedure any more; remove it")
        found = self.check(order.procedure, order.serial)
        if not found["ok"]:
            raise NotStartedError(str(found.get("error", "")))
        self._begin(order)

    def _begin(self, order: Order) -> Path:
        folder = new_folder(order.procedure, order.serial, self.root)
        # before the run, so that an order is never carried out twice, whenever this process ends
        self.journal.note("started", **asdict(order), campaign=folder.name)
        self._launch(folder, order, order.by, "--out", str(folder))
        return folder

    def _launch(self, folder: Path, order: Order, who: str, *where: str) -> None:
        """Start `benchctl run` and wait until it has begun; `NotStartedError` if it has not."""
        before, log = _starts(folder), folder.with_name(f"{folder.name}.log")
        with log.open("ab") as out:
            limits = self.procedures[order.procedure].limits
            judged = [] if limits is None else ["--limits", str(limits)]
            arguments = ["run", *self._command(order.procedure, order.serial), f"--page={who}", *judged, *where]
            run = own_process("benchctl", arguments, stdout=out, stderr=subprocess.STDOUT)
        if run.stdin is not None:
            run.stdin.close()
        self._process = run
        ends_s = time.monotonic() + _BEGUN_WITHIN_S
        while _starts(folder) == before:
            if run.poll() is not None:
                reason = _last_line(log, folder)
                self.journal.note("refused", reason=reason)
                raise NotStartedError(reason)
            if time.monotonic() > ends_s:
                raise NotStartedError(
                    f"{folder.name} has not begun after {_BEGUN_WITHIN_S:g} s; the list of campaigns will show it if "
                    "its instruments answer"
                )
            time.sleep(0.1)

    def _is_on(self, run: StationRun | None) -> bool:
        """Return whether the run that was started last is on the bench, or its program has not ended yet."""
        if run is None or run.fault is not None:
            return False
        by_this_process = self._process is not None and self._process.poll() is None
        return by_this_process or is_held(self.root / run.campaign / LOCK)

    def _refuse_run(self) -> None:
        run = self.journal.run
        if run is not None and self._is_on(run):
            raise NotStartedError(f"{run.campaign} is on this bench; wait until it is over, or stop it")

    def _refuse_known(self, order: Order) -> None:
        if self.journal.knows(order.order):
            raise NotStartedError("this order was placed before, and is not carried out twice; place a new one")

    def _require_hold(self, hold: int) -> None:
        if not self.journal.held or hold != self.journal.hold:
            raise NotStartedError("the queue does not hold any more, or for another reason; look at it again")

    def _let_go_on(self, who: str) -> None:
        if self.journal.held:
            self.journal.note("go_on", by=who)

    def _command(self, name: str, serial: str) -> tuple[str, ...]:
        return (*self.procedures[name].command, "--bench", str(self._file), f"--unit={serial}")


def _starts(folder: Path) -> int:
    """Return how often the live page has started or resumed a campaign, according to its journal."""
    return sum(event.get("kind") == "started" for event in events_in(journal_text(folder / JOURNAL)))


def _fault(folder: Path) -> str:
    """Return why a run has not ended properly; empty if it is complete and the bench is in its safe state."""
    events = list(events_in(journal_text(folder / JOURNAL)))
    status, reason = last_word(events)
    unsafe = next((event.get("problems") for event in reversed(events) if event.get("kind") == "safe"), ["no word"])
    if unsafe:
        return f"{reason or status}; the bench is not known to be in its safe state"
    return "" if status == "complete" else reason or status


def _last_line(log: Path, folder: Path) -> str:
    """Return why a run was refused; remove its log if that has nothing else."""
    lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines() or ["it ended without a word"]
    if not folder.exists():
        with suppress(OSError):
            log.unlink()
    return lines[-1].removeprefix("benchctl: ")
