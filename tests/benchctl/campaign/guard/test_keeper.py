"""The runner's end of the guard, with real guard processes; their orders name instruments that are not there."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from benchctl.bench import Bench, load_bench, template
from benchctl.campaign.guard import keeper
from benchctl.campaign.guard.keeper import GuardProcess, NoGuard, guarded
from benchctl.campaign.opened import open_bench
from benchctl.campaign.safety import Supervisor
from benchctl_instruments.errors import SafetyError

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals between processes")


class Run:
    """A run's journal and its guard."""

    def __init__(self, guard: GuardProcess) -> None:
        self.guard = guard
        self.says: list[str] = []

    def event(self, kind: str, **data: object) -> None:
        assert kind == "guard"
        self.says.append(str(data["says"]))

    @property
    def pid(self) -> int:
        return int(re.findall(r"process (\d+)", self.says[-1])[-1])

    def beat_until(self, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + 20
        while not condition():
            assert time.monotonic() < deadline_s, self.says
            self.guard.beat()
            time.sleep(0.01)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    text = template().replace("simulated = true", "simulated = false")
    text = re.sub(r'# address = "tcp://[^"]+"', 'address = "tcp://127.0.0.1:9"', text)
    (tmp_path / "real.toml").write_text(text, encoding="utf-8")
    return load_bench(str(tmp_path / "real.toml"))


@pytest.fixture
def run(bench: Bench, tmp_path: Path) -> Iterator[Run]:
    with guarded(bench, tmp_path / "journal.jsonl") as guard:
        assert isinstance(guard, GuardProcess)
        run = Run(guard)
        yield run
        guard.done()


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_a_simulated_bench_needs_none(tmp_path: Path) -> None:
    with guarded(load_bench("simulated"), tmp_path / "journal.jsonl") as guard:
        assert isinstance(guard, NoGuard)
        assert guard.promise == guard.lost == ""


def test_once_armed_it_is_alive_and_once_told_done_it_goes_without_a_word(run: Run, tmp_path: Path) -> None:
    run.guard.arm(run.event)
    assert run.says == [f"process {run.pid} guards the run"]
    assert not gone(run.pid)
    run.guard.done()
    run.beat_until(lambda: gone(run.pid))
    assert not (tmp_path / "journal.jsonl").exists()


def test_a_run_that_ends_before_anything_moved_needs_nothing_done(bench: Bench, tmp_path: Path) -> None:
    with guarded(bench, tmp_path / "journal.jsonl") as guard:
        assert isinstance(guard, GuardProcess)
        process = guard._child
        assert process is not None
    deadline_s = time.monotonic() + 20
    while not process.gone():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    assert process.gone() == "ended (exit status 0)"
    assert not (tmp_path / "journal.jsonl").exists()


def test_guards_that_die_are_replaced_and_after_the_last_the_run_is_ended(run: Run) -> None:
    run.guard.arm(run.event)
    for number in range(1, keeper.MOST_REPLACED + 1):
        killed = run.pid
        os.kill(killed, signal.SIGKILL)
        run.beat_until(lambda: len(run.says) > number)  # noqa: B023 - asked at once
        assert run.says[-1] == f"process {killed} ended (exit status -9); process {run.pid} takes its place"
    os.kill(run.pid, signal.SIGKILL)
    run.beat_until(lambda: bool(run.guard.lost))
    times = keeper.MOST_REPLACED + 1
    assert (
        run.guard.lost == f"the guard process ended (exit status -9), {times} times in this run; find out what ends it"
    )
    assert run.guard.promise == ""
    with open_bench(load_bench("simulated"), wires=False) as opened:
        supervisor = Supervisor(opened, run.event, run.guard)
        with pytest.raises(SafetyError, match="find out what ends it"):
            supervisor.look_at_table()


def test_a_guard_that_is_stuck_is_replaced_and_never_makes_the_runner_wait(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeper, "BEAT_EVERY_S", 0.0)
    run.guard.arm(run.event)
    stuck = run.pid
    os.kill(stuck, signal.SIGSTOP)
    began_s = time.monotonic()
    for _ in range(20_000):  # more than any pipe would hold
        run.guard.beat()
    assert time.monotonic() - began_s < 10.0
    assert not gone(stuck)
    monkeypatch.setattr(keeper, "ANSWER_S", 0.2)
    run.beat_until(lambda: len(run.says) > 1)
    monkeypatch.setattr(keeper, "ANSWER_S", 30.0)
    assert run.says[-1].startswith(f"process {stuck} has not answered for 0.2 s; process ")
    run.beat_until(lambda: gone(stuck))


def test_a_guard_that_cannot_start_keeps_everything_from_moving(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with guarded(bench, tmp_path / "journal.jsonl") as guard:
        with pytest.raises(SafetyError, match=r"the guard process ended .*; without a guard nothing is moved"):
            guard.arm(lambda kind, **data: None)
        guard.done()
